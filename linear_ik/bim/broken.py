"""What a file that contradicts its own schema makes the libraries raise."""

from __future__ import annotations

# Attributes that are missing, of another kind, or no numbers; what the geometry kernel cannot process.
BROKEN = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)


def said(error: Exception) -> str:
    """Return the kind and the text of an error on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
