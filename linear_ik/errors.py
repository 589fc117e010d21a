"""What goes wrong, said to the person who can mend it."""

from __future__ import annotations


class LinearIkError(Exception):
    """Root of every error that linear_ik raises on purpose.

    Attributes:
        subject: what the error is about: a file, or the name of an argument.
        what: what is wrong, with the value that is.
        expected: what would have been right, or an empty string.
    """

    def __init__(self, subject: object, what: str, expected: str = "") -> None:
        """Say ``subject: what (expected)``."""
        self.subject = str(subject)
        self.what = what
        self.expected = expected
        super().__init__(str(self))

    def __str__(self) -> str:
        """One line, whatever the parts contain."""
        line = f"{self.subject}: {self.what}"
        if self.expected:
            line += f" ({self.expected})"
        return " ".join(line.split())

    def about(self, subject: object) -> LinearIkError:
        """Return the same error, said of ``subject`` (a file instead of an argument)."""
        return type(self)(subject, self.what, self.expected)


class ElementError(LinearIkError):
    """An element description that describes no element."""


class DesignError(LinearIkError):
    """A design model that cannot be read, or that holds no linear element."""


class ScanError(LinearIkError):
    """A scan that cannot be read, or that holds no points."""


class SettingsError(LinearIkError):
    """A setting outside what the method allows."""


class ChainError(LinearIkError):
    """A URDF that is not a chain of segments."""


class StepError(LinearIkError):
    """A quadratic program of one IK step that no solver could solve."""


class ToleranceError(LinearIkError):
    """A file of tolerances that cannot be used as it stands."""


class OutputError(LinearIkError):
    """A file that cannot be written where it was asked for."""
