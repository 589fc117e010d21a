"""The fit of a whole building: every linear element of a design model, to one scan of the site."""

from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.model_fit.run import ModelFit, fit_model

__all__ = ["ModelFit", "ModelFitOptions", "fit_model"]
