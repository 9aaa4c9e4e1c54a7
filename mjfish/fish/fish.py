"""The fish: links, masses, outline, hydrodynamic coefficients.

Read from TOML and written to it, as the same fish to the last bit; `fishes` has shipped ones.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    RootModel,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from mjfish.errors import InputError, ParameterError, UnknownNameError
from mjfish.files import tomlfile, writing
from mjfish.files.checksummed_json import digest
from mjfish.files.tomlfile import Table, complaining, consistent
from mjfish.fish import parameter_priors
from mjfish.fish.parameter_priors import FishParameterPrior
from mjfish.parameters import Parameter

#: Kinds of coefficients, in the order of [Yu2016], Table III.
KINDS = {"c_m": "inertia (added mass)", "c_d": "drag across the body", "c_f": "skin friction along the body"}

# Limits beyond which no swimmer is, and within which nothing that is computed overflows.
Positive = Annotated[float, Field(gt=0.0, le=1e9)]
NotNegative = Annotated[float, Field(ge=0.0, le=1e9)]
Length = Annotated[float, Field(ge=1e-6, le=1e4)]
Station = Annotated[float, Field(ge=-1e4, le=1e4)]
Mass = Annotated[float, Field(ge=1e-9, le=1e9)]
Inertia = Annotated[float, Field(ge=1e-18, le=1e12)]
Constant = Annotated[float, Field(ge=-1e6, le=1e6)]
#: Lower and upper end.
Span = tuple[float, float]
#: In place of the body that coefficients belong to: any.
ANY = "any"
#: Links of one group share their coefficients; its name is a part of theirs.
Group = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]


def _not_negative_pair(pair: tuple[float, float]) -> tuple[float, float]:
    if min(pair) < 0.0 or max(pair) <= 0.0:
        raise ValueError("both ends must be at least 0 and one above 0 m")
    if max(pair) > 1e4:
        raise ValueError(f"found {max(pair):g} m, expected at most 10000 m")
    return pair


Ends = Annotated[tuple[float, float], AfterValidator(_not_negative_pair)]


class Section(Table):
    """A piece of the outline between two stations [m from the nose]; its sections are ellipses.

    ``linear``: a + (b - a) s; ``elliptic``: a + (b - a) sqrt(1 - (1 - s)^2), with s from 0 to 1 over the piece and
    (a, b) the ends given in `height` and `width` [m].
    """

    start: Station = Field(alias="from", ge=0.0)
    end: Length = Field(alias="to")
    profile: Literal["linear", "elliptic"] = "linear"
    height: Ends
    width: Ends

    _ordered = consistent(
        lambda own: own.end > own.start,
        "a section must end ('to' = {0.end:g}) behind its start ('from' = {0.start:g})",
    )


class Link(Table):
    """A rigid body of the chain; its frame sits at its front joint (the head's at the nose).

    Attributes:
        name: also the name of its MuJoCo body.
        group: whose coefficients it shares.
        length: to the next joint, or to the tip [m].
        mass: [kg].
        com: distance of the centre of mass from the frame's origin, towards the tail [m].
        inertia: about the vertical axis through the centre of mass [kg m2].
    """

    name: str = Field(min_length=1)
    group: Group
    length: Length
    mass: Mass
    com: Station
    inertia: Inertia


class Cpg(Table):
    """Constants of the Hopf-oscillator CPG, [Yu2016] eq. (20) and Table II.

    Attributes:
        amplitude: A_i, one a joint.
        h1: coupling from the joint in front.
        h2: coupling from the joint behind.
        beta: magnification, theta_i = beta * unit * psi_i.
        unit: size of one unit of beta * psi [rad].
        phase: phi, the same for every joint [rad].
    """

    amplitude: tuple[Positive, ...]
    h1: Constant
    h2: Constant
    beta: Positive
    unit: Positive
    phase: Constant


class Servo(Table):
    """Position servo of every joint in MuJoCo: torque = kp (command - angle) - kv rate.

    Attributes:
        kp: stiffness [N m/rad].
        kv: damping [N m s/rad].
    """

    kp: Positive
    kv: NotNegative


class Coefficient(Table):
    """Value, start and bounds of one dimensionless hydrodynamic coefficient, [Yu2016] Table III.

    `sd`: how well it is known; None: the bounds alone are. See `mjfish.Parameter.deviation`. `mean`: what the sd is
    about; None: the value.
    """

    value: NotNegative
    start: NotNegative
    low: NotNegative
    high: Positive
    sd: Positive | None = None
    mean: NotNegative | None = None


class ByGroup(RootModel[dict[Group, Coefficient]]):
    """One kind of coefficient, by group of links."""

    model_config = ConfigDict(frozen=True)

    def __hash__(self) -> int:
        """Return a hash of groups and coefficients, in any order: a fish is a key of what was computed with it."""
        return hash(frozenset(self.root.items()))


class Coefficients(Table):
    """Coefficients of inertia, drag and friction."""

    c_m: ByGroup
    c_d: ByGroup
    c_f: ByGroup


class Identified(Table):
    """The table ``identified`` of a fish TOML.

    Attributes:
        geometry: `Fish.geometry` of the body that the coefficients belong to, or ``any``.
        dataset: that they were fitted to.
        by: version of mjfish.
        outcome: of the fit, in words.
        range: least and most over the fitted runs: ``speed``, from the mean surge of the second half of a run to that
            of its fastest quarter [m/s]; ``beat``, its frequency [Hz]; ``amplitude``, half of the widest swing of a
            joint [rad]. What no run shows is left out.
        intervals: 95 % intervals by full name, of coefficients, free numbers of the body, and causes. What was not
            fitted, or what the data do not say, has none.
    """

    geometry: str
    dataset: str
    by: str
    outcome: str
    range: dict[str, Span]
    intervals: dict[str, Span]

    def __hash__(self) -> int:
        """Return a hash: a fish is a key of what was computed with it."""
        return hash((self.geometry, self.dataset, self.outcome))


class Fish(Table):
    """A planar swimmer: a chain of links, nose first.

    Attributes:
        name: of the fish.
        about: where the numbers come from.
        density: of the water [kg/m3].
        munk_moment: share kappa of the Munk moment u p_y; 0 is a Morison slice, 1 Kirchhoff's.
        tail_compliance: elastic deflection of the last link about its joint [rad/(N m)]; 0 is rigid.
        tail_damping: damping of that deflection [N m s/rad].
        tail_quadratic: how its moment grows, M = delta (1 + quadratic |delta| + hardening delta^2) / compliance
            [1/rad]; below zero it gives way ever more at first. It rises with the deflection: quadratic^2 <= 3
            hardening where below zero.
        tail_hardening: see there [1/rad2].
        links: nose first.
        sections: the outline, nose to tip, without gaps.
        coefficients: of inertia, drag and friction, one of each for every group of links: nine of a fish with head,
            body and tail.
        schema_: of the file, 1.
        cpg: the oscillator that drives the joints; absent where joint angles are always measured.
        servo: of the joints, in MuJoCo only.
        identified: the body and the runs that the coefficients were fitted to; None: they come from no fit.
        known: the numbers that are given as ``{ value, sd }`` or ``{ value, low, high }``: they are free in a fit.

    Example:
        >>> import mjfish
        >>> fish = mjfish.load_fish("pike")
        >>> print(f"{fish.length:.3f} m, {sum(link.mass for link in fish.links):.2f} kg")
        0.614 m, 2.11 kg
        >>> fish.values["c_m.tail"]
        0.06
    """

    schema_: Literal[1] = Field(alias="schema")
    name: str = Field(min_length=1)
    about: str = ""
    density: Positive = Field(default=1000.0, le=1e6)
    munk_moment: float = Field(default=0.0, ge=-2.0, le=3.0)
    tail_compliance: NotNegative = Field(default=0.0, le=1e6)
    tail_damping: NotNegative = Field(default=0.02, le=1e6)
    tail_quadratic: float = Field(default=0.0, ge=-1e6, le=1e6)
    tail_hardening: NotNegative = Field(default=0.0, le=1e6)
    links: tuple[Link, ...] = Field(min_length=2)
    sections: tuple[Section, ...] = Field(min_length=1)
    coefficients: Coefficients
    cpg: Cpg | None = None
    servo: Servo | None = None
    identified: Identified | None = None
    known: tuple[FishParameterPrior, ...] = ()

    def __init__(self, **keys: object) -> None:
        """Make a fish by hand; what is wrong is said as of a file."""
        with complaining("Fish"):
            super().__init__(**keys)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # `parse` does not come here

    @model_validator(mode="before")
    @classmethod
    def _split(cls, raw: object) -> object:
        plain, known = parameter_priors.split(raw)
        return {**plain, "known": tuple(known)} if known and isinstance(plain, dict) else plain

    @model_serializer(mode="wrap")
    def _joined(self, handler: SerializerFunctionWrapHandler) -> dict[str, object]:
        table = handler(self)
        table.pop("known", None)
        return parameter_priors.joined(table, self.known)

    @model_validator(mode="after")
    def _consistent(self) -> Fish:
        if len({link.name for link in self.links}) < len(self.links):
            raise ValueError("two links share a name; give each its own")
        self._check_groups()
        if self.cpg is not None and len(self.cpg.amplitude) != self.joints:
            raise ValueError(
                f"cpg.amplitude has {len(self.cpg.amplitude)} numbers, the fish has {self.joints} joints; "
                "give one number a joint"
            )
        if self.tail_quadratic < 0.0 and self.tail_quadratic**2 > 3.0 * self.tail_hardening * (1.0 + 1e-9):
            raise ValueError(
                f"tail_quadratic = {self.tail_quadratic:g} makes the moment of the tail fall with its deflection; "
                f"give at least {-((3.0 * self.tail_hardening) ** 0.5):g}, or a larger hardening"
            )
        self._check_outline()
        if self.identified is not None and self.identified.geometry not in (ANY, self.geometry):
            raise ValueError(
                f"identified.geometry: the coefficients were fitted to dataset '{self.identified.dataset}' on another "
                "body, expected the links and sections of this one; identify them on this body, or write "
                f'geometry = "{ANY}" in [identified] to use them on it all the same'
            )
        for parameter in self.parameters:  # raises where bounds, start and value contradict each other
            parameter.check(parameter.default)
        try:
            names = [parameter.name for parameter in self.numbers]
        except ParameterError as error:
            raise ValueError(str(error)) from None
        for name in names:
            if ":" in name or name in self.coefficient_names:
                raise ValueError(f"{name}: not a name for a free number; rename the link")
        return self

    def _check_groups(self) -> None:
        for kind in KINDS:
            given = getattr(self.coefficients, kind).root
            for group in self.groups:
                if group not in given:
                    raise ValueError(f"coefficients.{kind} has no '{group}', a group of the links; add it")
            for group in given:
                if group not in self.groups:
                    raise ValueError(
                        f"coefficients.{kind}.{group}: no link is of this group; the links have "
                        f"{', '.join(self.groups)}"
                    )

    def _check_outline(self) -> None:
        if self.sections[0].start != 0.0:
            raise ValueError(f"sections must begin at the nose (from = 0), not at {self.sections[0].start:g} m")
        for before, after in zip(self.sections, self.sections[1:], strict=False):
            if abs(after.start - before.end) > 1e-9:
                raise ValueError(
                    f"sections leave a gap or overlap between {before.end:g} and {after.start:g} m; "
                    "let each begin where the one before it ends"
                )
        if abs(self.sections[-1].end - self.length) > 1e-9:
            raise ValueError(
                f"sections end at {self.sections[-1].end:g} m, the links at {self.length:g} m; make both end at the tip"
            )

    @property
    def joints(self) -> int:
        """Number of joints, one less than links."""
        return len(self.links) - 1

    @property
    def length(self) -> float:
        """Length from nose to tip [m]."""
        return sum(link.length for link in self.links)

    @property
    def geometry(self) -> str:
        """The body that the coefficients hold for: SHA-256 of its links, without their names, and sections."""
        return digest([[own.model_dump(exclude={"name"}) for own in part] for part in (self.links, self.sections)])

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of links that share coefficients, nose first."""
        return tuple(dict.fromkeys(link.group for link in self.links))

    @property
    def _coefficients(self) -> dict[str, Coefficient]:
        found = ((name, *name.split(".", 1)) for name in self.coefficient_names)
        return {name: getattr(self.coefficients, kind).root[group] for name, kind, group in found}

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, ``c_m.head`` and so on: kind by kind, in each group by group."""
        return tuple(f"{kind}.{group}" for kind in KINDS for group in self.groups)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients as declared parameters, in the order of `coefficient_names`."""
        try:
            return tuple(
                Parameter(
                    name=name,
                    unit="-",
                    default=own.value,
                    low=own.low,
                    high=own.high,
                    start=own.start,
                    scale=max(0.1 * own.start, 1e-3 * (own.high - own.low)),
                    about=f"{KINDS[name.partition('.')[0]]}, {name.partition('.')[2]}",
                    sd=own.sd,
                    mean=own.mean,
                )
                for name, own in self._coefficients.items()
            )
        except ParameterError as error:
            raise ValueError(f"coefficients.{error}") from None

    @property
    def numbers(self) -> tuple[Parameter, ...]:
        """The other numbers that are free, such as ``mass.head``, as declared parameters."""
        return tuple(parameter_priors.parameters(self.known, self))

    def with_numbers(self, values: Mapping[str, float]) -> Fish:
        """Return the fish with other values of the numbers that are free; others in `values` are ignored.

        Where the length of a link changes, the sections along it are stretched, and those behind move along.
        """
        links, sections, known = list(self.links), list(self.sections), []
        own: dict[str, object] = {}
        for one, parameter in zip(self.known, self.numbers, strict=True):
            value = values.get(parameter.name, parameter.default)
            moved = one.sd is not None and one.mean is None and value != parameter.default
            known.append(one.model_copy(update={"mean": parameter.default}) if moved else one)
            match one.place:
                case ("links", int() as number, str() as key):
                    links[number] = links[number].model_copy(update={key: value})
                case ("sections", int() as number, str() as key, int() as end):
                    pair = getattr(sections[number], key)
                    pair = (value, pair[1]) if end == 0 else (pair[0], value)
                    sections[number] = sections[number].model_copy(update={key: pair})
                case (str() as key,):
                    own[key] = value
        before, after = ([0.0, *itertools.accumulate(link.length for link in chain)] for chain in (self.links, links))
        if before != after:
            ends = [float(v) for v in np.interp([section.end for section in sections], before, after)]
            starts = [0.0, *ends[:-1]]
            sections = [
                section.model_copy(update={"start": start, "end": end})
                for section, start, end in zip(sections, starts, ends, strict=True)
            ]
        changed = {"links": tuple(links), "sections": tuple(sections), "known": tuple(known), **own}
        return self.model_copy(update=changed)

    @property
    def values(self) -> dict[str, float]:
        """The coefficients by name."""
        return {name: own.value for name, own in self._coefficients.items()}

    def with_coefficients(self, parameters: Mapping[str, Parameter]) -> Fish:
        """Return the fish with other declarations (value, start, bounds) for the named coefficients."""
        kinds: dict[str, dict[str, Coefficient]] = {kind: dict(getattr(self.coefficients, kind).root) for kind in KINDS}
        for name, new in parameters.items():
            if name not in self.coefficient_names:
                raise UnknownNameError("coefficient", name, self.coefficient_names)
            kind, _, group = name.partition(".")
            mean = None if new.sd is None or new.expected == new.default else new.expected
            kinds[kind][group] = Coefficient(
                value=new.default, start=new.start, low=new.low, high=new.high, sd=new.sd, mean=mean
            )
        changed: dict[str, object] = {"coefficients": Coefficients(**{k: ByGroup(own) for k, own in kinds.items()})}
        if (record := self.identified) is not None:
            of = {
                "geometry": ANY if record.geometry == ANY else self.geometry,  # free numbers may have changed, too
                "intervals": {name: ends for name, ends in record.intervals.items() if name not in parameters},
            }
            changed["identified"] = record.model_copy(update=of)
        return self.model_copy(update=changed)

    def with_values(self, values: Mapping[str, float]) -> Fish:
        """Return the fish with other values of the named coefficients, each checked against its bounds."""
        declared = {parameter.name: parameter for parameter in self.parameters}
        for name in values.keys() - declared.keys():
            raise UnknownNameError("coefficient", name, self.coefficient_names)
        changed = {name: replace(declared[name], default=declared[name].check(float(v))) for name, v in values.items()}
        return self.with_coefficients(changed)


def shipped() -> dict[str, Path]:
    """Return the fish that come with the package, by name."""
    return {path.stem: path for path in sorted((Path(__file__).parent / "fishes").glob("*.toml"))}


@functools.lru_cache(maxsize=32)
def _read(path: Path, _stamp: int) -> tuple[Fish, object]:
    table = tomlfile.table(path)
    effects = table.pop("effects", {})
    return tomlfile.parse(table, Fish, str(path)), effects


def load_fish(name_or_path: str | Path, relative_to: Path | None = None) -> Fish:
    """Load a shipped fish by name, or a fish TOML by path.

    Args:
        name_or_path: e.g. ``pike``, or ``my_fish.toml``.
        relative_to: folder that a relative path starts from (default: the working folder).

    Raises:
        UnknownNameError: no shipped fish of that name and no such file.
        InputError: the file breaks the schema, every broken key is named; or it has effects, which would be lost.

    Example:
        >>> import mjfish
        >>> mjfish.load_fish("pike").joints
        4
    """
    fish, effects = read(name_or_path, relative_to)
    if effects:
        raise InputError(f"{name_or_path}: has [effects], which are lost here; only simulate and check take them along")
    return fish


def read(name_or_path: str | Path, relative_to: Path | None = None) -> tuple[Fish, object]:
    """Load a fish that effects may extend like `load_fish`; return the table ``effects`` too, as it stands."""
    known = shipped()
    path = known.get(str(name_or_path), (relative_to or Path()) / name_or_path)
    if path.suffix.lower() != ".toml" and not writing.exists(path):
        raise UnknownNameError("fish", str(name_or_path), known, "or give the path of a fish TOML")
    if not (writing.exists(path) and path.is_file()):
        raise InputError(f"{path}: no such fish file; shipped fish: {', '.join(known)}")
    return _read(path.resolve(), path.stat().st_mtime_ns)


def fish_text(
    fish: Fish, comments: Sequence[str] = (), effects: Mapping[str, Mapping[str, float]] = MappingProxyType({})
) -> str:
    """Return the fish as TOML.

    Args:
        fish: the fish.
        comments: lines at the top, such as where the numbers come from.
        effects: that extend it, by name, their parameters by short name (`mjfish.model.extended` reads them back).

    Raises:
        InputError: the fish breaks its own schema, so that it could not be read back.
    """
    table = fish.model_dump(by_alias=True)
    if tomlfile.parse(table, Fish, f"fish '{fish.name}'") != fish:
        raise InputError(f"fish '{fish.name}' holds values of types that TOML does not keep; build it by Fish(...)")
    lines = [
        f"# {line}".rstrip()
        for comment in comments  # TOML forbids control characters in them
        for line in "".join(c if c.isprintable() or c == "\n" else " " for c in comment).splitlines()
    ]
    return "\n".join([*lines, tomlfile.text({**table, "effects": effects} if effects else table)])


def write_fish(
    path: str | Path,
    fish: Fish,
    comments: Sequence[str] = (),
    effects: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> None:
    """Write the fish to the TOML file `path`, whole or not at all.

    Args:
        path: with the suffix ``.toml``, by which `mjfish.fish.load_fish` knows a file from a name.
        fish: the fish.
        comments: lines at the top.
        effects: that extend it, as in `fish_text`.

    Raises:
        InputError: another suffix, the file cannot be written, or the fish could not be read back.
    """
    path = Path(path)
    writing.check_suffix(path, ".toml")
    writing.write_text(path, fish_text(fish, comments, effects))
