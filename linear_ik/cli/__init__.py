"""The command `linear-ik`: one module a verb."""

from linear_ik.cli.app import app, main

__all__ = ["app", "main"]
