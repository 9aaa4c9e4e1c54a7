"""The battery: sealed cases drawn, diagnosed and judged; the figures they make, and simple guessers beside them."""
