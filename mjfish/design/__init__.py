"""The next experiment: which run or calibration would tell rival causes apart, and how surely."""

from mjfish.design.fitted_models import FittedModels, ModelEstimate, Question, load_fitted_models
from mjfish.design.information import Separation, excluded, separations
from mjfish.design.menu import Menu, Run
from mjfish.design.planning import Option, Pair, Plan, plan, write_next_run

__all__ = [
    "FittedModels",
    "Menu",
    "ModelEstimate",
    "Option",
    "Pair",
    "Plan",
    "Question",
    "Run",
    "Separation",
    "excluded",
    "load_fitted_models",
    "plan",
    "separations",
    "write_next_run",
]
