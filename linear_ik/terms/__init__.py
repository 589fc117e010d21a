"""Terms of the IK step's quadratic program, each one an Objective(H, c)."""

from linear_ik.terms.objective import Objective

__all__ = ["Objective"]
