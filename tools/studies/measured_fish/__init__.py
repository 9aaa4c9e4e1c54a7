"""The measured fish of srl-ethz/fishsim: diagnosed, scored, and written to docs/real-fish.md."""
