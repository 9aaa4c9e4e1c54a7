"""How sure a fit is: intervals, profiles, weak directions, and whether every trial says the same."""
