"""Judging diagnoses: answers to sealed cases, the figures that they make, and the simple guessers beside them."""
