"""The numbers of `docs/theory.md`, as tables; each function measures one anew."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from mjfish.mujoco.coupling_choice import Coupling
from proofs import (
    closed_forms,
    conservation,
    constraints,
    derivation,
    derivatives,
    integrator_steps,
    lagged_added_mass,
    symmetry,
    trees,
)
from proofs.parts import VALID

COUPLINGS: tuple[Coupling, Coupling] = ("inertia", "xfrc")


@dataclass(frozen=True)
class Table:
    """A table of Markdown.

    Attributes:
        title: what it shows, in a sentence.
        head: names of the columns.
        rows: cells, as text.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Return the table as it stands in the docs."""
        lines = (self.head, ("---",) * len(self.head), *self.rows)
        return "\n".join([self.title, "", *("| " + " | ".join(line) + " |" for line in lines)])


def _small(value: float) -> str:
    """Write an error: one digit is enough."""
    return "0" if value == 0.0 else f"{value:.0e}" if value < 1e-3 else f"{value:.2g}"


def _integrators(coupling: Coupling) -> list[str]:
    return [integrator for one, integrator in VALID if one == coupling]


def _worst(of: Callable[..., float], **options: bool) -> list[str]:
    """Return the worst of all integrators for each coupling."""
    return [_small(max(of(coupling, name, **options) for name in _integrators(coupling))) for coupling in COUPLINGS]


def push_table() -> Table:
    """A pushed link."""
    worst = {
        coupling: _most(
            closed_forms.difference(c_m, coupling, name) for c_m in (0.06, 1.0, 30.0) for name in _integrators(coupling)
        )
        for coupling in COUPLINGS
    }
    rows = [(name, *(_small(worst[coupling][name]) for coupling in COUPLINGS)) for name in worst["inertia"]]
    return Table(
        "A plate is pushed or turned from rest. Relative error of its acceleration against the closed form, largest of "
        "c_m = 0.06, 1, 30 and of all integrators that the coupling allows:",
        ("push", *COUPLINGS),
        tuple(rows),
    )


def _most(found: Iterable[dict[str, float]]) -> dict[str, float]:
    every = list(found)
    return {name: max(one[name] for one in every) for name in every[0]}


def derivation_table() -> Table:
    """The force, derived twice."""
    rows = [
        (f"added mass, gyroscopic, Munk moment; κ = {kappa:g}", _small(derivation.inertial_difference(kappa)))
        for kappa in (0.0, 0.5, 1.0)
    ]
    for roots, where in enumerate(("neither", "one", "both")):
        found = derivation.drag_differences(roots)
        told = f"{_small(float(np.median(found)))}, at worst {_small(found.max())}"
        rows.append((f"drag against adaptive quadrature, {where} of q_y, q_z changing sign on the link; median", told))
    rows.append(("drag of the plane against `hydro/force.py`", _small(derivation.planar_difference())))
    for coupling in COUPLINGS:
        rows += [
            (f"a free chain in a current, no drag: M q̈ + c - τ against Jᵀ F of the slices, {coupling}",
             _small(derivation.balance(coupling, c_d=0.0))),
            (f"the same with drag, {coupling}", _small(derivation.balance(coupling))),
        ]  # fmt: skip
    return Table(
        "The force in space against slices that share no formula with it (each minus the rate of its momentum, "
        "differentiated numerically), at random states, relative to the largest force:",
        ("what", "difference"),
        tuple(rows),
    )


def sweep_table() -> Table:
    """Light to heavy added mass."""
    rows = []
    for ratio in lagged_added_mass.RATIOS:
        ours = [_small(lagged_added_mass.run(ratio, coupling).error) for coupling in COUPLINGS]
        behind = lagged_added_mass.run(ratio, None)
        told = f"diverged at step {behind.diverged}" if behind.diverged >= 0 else f"error {_small(behind.error)}"
        rows.append((f"{ratio:g}", *ours, told))
    return Table(
        "Added mass over mass. A plate glides, pushed and turned to and fro, 400 steps of Euler at 1 ms. Relative "
        "error of its acceleration against the dense solution in the second half of the run, beside a scheme that "
        "takes the added-mass force from the step before:",
        ("m_A / m", *COUPLINGS, "lagged"),
        tuple(rows),
    )


def conservation_table() -> Table:
    """What must stay."""
    rows = []
    for name, free in (("body", (trees.CROOKED,)), ("chain", trees.chain())):
        for current in (False, True):
            for coupling in COUPLINGS:
                found = conservation.drifts(free, coupling, current=current)
                fluid = "current" if current else "still water"
                for k, kept in enumerate(conservation.KEPT):
                    coarse, fine = found.relative[0, k], found.relative[-1, k]
                    cells = (f"{name}, {fluid}", coupling, kept, _small(coarse), _small(fine), f"{found.orders[k]:.2f}")
                    rows.append(cells)
    return Table(
        "No drag, κ = 1, nothing applied, RK4: the largest relative change of what must stay, in the frame that drifts "
        "with the water, within 0.8 s; the order is fitted over four halvings of the step:",
        ("free", "coupling", "kept", "step 4 ms", "0.25 ms", "order"),
        tuple(rows),
    )


def step_table() -> Table:
    """A step of every integrator."""
    rows = []
    for one, integrator, euler_damp in integrator_steps.DAMPED:
        named = integrator if euler_damp else f"{integrator}, eulerdamp disabled"
        dense = ["-", "-"]
        if one == "inertia" and euler_damp and integrator in integrator_steps.ONE_STEP:
            dense = [
                _small(integrator_steps.step_difference(tree, integrator)) for tree in ((trees.CROOKED,), trees.chain())
            ]
        order, error = integrator_steps.convergence(one, integrator, euler_damp=euler_damp)
        slopes = "-"
        if integrator != "RK4":
            slopes = _small(derivatives.transition_difference(one, integrator, euler_damp=euler_damp))
        rows.append((named, one, *dense, f"{order:.2f}", _small(error), slopes))
    return Table(
        "Joints damped, sprung and served, water with drag, in a current. The step (v⁺ - v) / h against the dense "
        "solution of the integrator's equation; the order at which runs of 0.24 s approach one and the same (RK4, "
        "0.125 ms), and their error at 1 ms; `mjd_transitionFD` against differences of `mj_step`; all relative:",
        ("integrator", "coupling", "step, free body", "step, chain", "order", "error at 1 ms", "A, B"),
        tuple(rows),
    )


def refused_table() -> Table:
    """What is refused."""
    rows = [
        (f"xfrc with {name} and damped, served joints", _small(integrator_steps.refused_difference(name)))
        for name in integrator_steps.ONE_STEP
    ]
    for case in constraints.CASES:
        active = "limits, frictionloss and contact" if case == "all" else case
        rows.append((f"xfrc with {active}", _small(constraints.balance(case, "Newton").xfrc)))
        rows.append((f"inertia and solver PGS with {active}", _small(constraints.pgs_error(case))))
    return Table(
        "What is refused, and how wrong the acceleration (the step) would have been, relative to the largest:",
        ("refused", "error"),
        tuple(rows),
    )


def constraint_table() -> Table:
    """Constraints."""
    rows = []
    for case in constraints.CASES:
        found = [constraints.balance(case, solver) for solver in ("Newton", "CG")]
        law = "-" if case == "contact" else _small(max(one.law for one in found))
        rows.append((case, str(found[0].active), *(_small(one.balance) for one in found), law))
    return Table(
        "Constraints active, six random states of the free chain, coupling inertia: what is left of (M + M_a) q̈ - "
        "force - Jᵀ f, relative to the largest force, and how far f of limits and frictionloss is from MuJoCo's law:",
        ("active", "rows that push", "Newton", "CG", "law"),
        tuple(rows),
    )


def symmetry_table() -> Table:
    """Symmetries."""
    rows = [
        ("mirror in the x-z plane", *_worst(symmetry.mirror)),
        ("world turned, gravity and current with it", *_worst(symmetry.turned_world)),
        ("drift with a current against still water", *_worst(symmetry.drifting)),
    ]
    told = {
        "stations counted from the other end": symmetry.from_the_other_end,
        "width called height, a quarter of a turn on": symmetry.width_for_height,
        "`up` turned about the axis of circular sections": symmetry.round_section,
        "one link described as two": symmetry.in_two_pieces,
    }
    for name, of in told.items():
        for drag in (False, True):
            cells = [_small(of(coupling, drag=drag)) for coupling in COUPLINGS]
            rows.append((f"{name}, {'with' if drag else 'without'} drag", *cells))
    return Table(
        "What must make no difference. The first three: velocities of 300 steps of the free chain, every integrator; "
        "the others: the acceleration of a crooked free body at 20 random states; relative:",
        ("symmetry", *COUPLINGS),
        tuple(rows),
    )


def inverse_table() -> Table:
    """Inverse dynamics."""
    found = [derivatives.inverse(coupling) for coupling in COUPLINGS]
    told = {
        "`qfrc_inverse` against the forces applied": "applied",
        'the same less `wrenches(data)["total"]`': "corrected",
        "slope of `mjd_inverseFD` against M": "rigid",
        "slope of `mjd_inverseFD` against M + M_a": "wet",
    }
    rows = [(name, *(_small(getattr(one, field)) for one in found)) for name, field in told.items()]
    return Table(
        "Inverse dynamics, which never asks for the water; relative difference:", ("what", *COUPLINGS), tuple(rows)
    )


#: In the order of the docs.
TABLES: tuple[Callable[[], Table], ...] = (
    push_table,
    derivation_table,
    sweep_table,
    step_table,
    constraint_table,
    refused_table,
    conservation_table,
    symmetry_table,
    inverse_table,
)
