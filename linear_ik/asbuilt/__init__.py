"""As-built models: the design file with the fitted elements in the shape that was found (extra bim)."""
