"""Water: the Morison force on strips, per link; compiled, and called by both engines."""
