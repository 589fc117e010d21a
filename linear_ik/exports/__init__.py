"""Files out: one module a format, all written whole or not at all."""
