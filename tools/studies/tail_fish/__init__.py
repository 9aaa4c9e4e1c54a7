"""The public runs of a one-joint fish: what mjfish says of them."""
