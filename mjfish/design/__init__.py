"""The next experiment: which run or calibration would tell rival causes apart, and how surely."""

from mjfish.design.advise import advise, plan
from mjfish.design.menu import Menu, Run
from mjfish.design.question import Question
from mjfish.design.result import Option, Pair, Plan
from mjfish.design.skeleton import generate

__all__ = ["Menu", "Option", "Pair", "Plan", "Question", "Run", "advise", "generate", "plan"]
