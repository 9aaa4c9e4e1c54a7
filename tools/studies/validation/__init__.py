"""The water of mjfish beside published numbers, written to docs/validation.md."""
