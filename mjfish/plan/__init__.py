"""The next experiment: which run or calibration would tell rival causes apart, and how surely."""

from mjfish.plan.advise import advise, plan
from mjfish.plan.menu import Menu, Run
from mjfish.plan.question import Question
from mjfish.plan.result import Option, Pair, Plan
from mjfish.plan.skeleton import generate

__all__ = ["Menu", "Option", "Pair", "Plan", "Question", "Run", "advise", "generate", "plan"]
