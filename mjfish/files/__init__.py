"""Files and plain data: written whole, read up to a size, TOML, JSON with a checksum, what every result saves."""
