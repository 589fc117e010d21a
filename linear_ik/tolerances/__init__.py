"""Tolerances: limits from editable files, and what the deviations of a member say to them."""

from linear_ik.tolerances.clause import Clause, Profile
from linear_ik.tolerances.conditions import Conditions, ConditionsOfEach, load_conditions, material_named
from linear_ik.tolerances.loa import Accuracy, level_of_accuracy
from linear_ik.tolerances.profile_file import IFC_CLASS, load_tolerances, shipped
from linear_ik.tolerances.unstressed import imperfection, sag_of
from linear_ik.tolerances.verdict import Verdict, overall, verdicts, verdicts_to_mapping

__all__ = [
    "IFC_CLASS",
    "Accuracy",
    "Clause",
    "Conditions",
    "ConditionsOfEach",
    "Profile",
    "Verdict",
    "imperfection",
    "level_of_accuracy",
    "load_conditions",
    "load_tolerances",
    "material_named",
    "overall",
    "sag_of",
    "shipped",
    "verdicts",
    "verdicts_to_mapping",
]
