"""A diagnosis that was saved: its text, tables, figures and page are made anew from the file, without another run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

from mjfish.diagnosis.result import SCHEMA, DiagnosisData
from mjfish.diagnosis.table import Table
from mjfish.errors import InputError
from mjfish.files import checksummed_json, size_limited
from mjfish.files.plain_data import restored
from mjfish.inspection import Finding, Inspection


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SavedDiagnosis(DiagnosisData):
    """What a file says of a diagnosis. It shows and writes all that a `Diagnosis` does, but for rerun log and fish.

    Attributes:
        content: of the file.
    """

    content: Mapping[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the file."""
        return dict(self.content)


def load_diagnosis(path: str | Path) -> SavedDiagnosis:
    """Read a ``diagnosis.json``, to show it again without another run.

    Args:
        path: of the file that ``mjfish diagnose --json`` or `Diagnosis.save` wrote.

    Returns:
        The diagnosis: ``summary()``, ``plot()``, ``report()``, ``write_curves()`` and the attributes of
        `mjfish.diagnosis.DiagnosisData` are as they were; each trial is there as measured and as both models predicted
        it (``overlays``). `mjfish.sample` and ``mjfish plan`` take the file itself.

    Raises:
        InputError: the file cannot be read, is no diagnosis, is of another version, or was changed or cut off since.

    Example:
        >>> import mjfish, tempfile
        >>> from mjfish.effects import find
        >>> pool = mjfish.generate("pike", ["v1", "v3"], noise=(0.01, 0.01, 0.05), duration=4.0)
        >>> file = tempfile.mkdtemp() + "/diagnosis.json"
        >>> found = mjfish.diagnose(pool, effects={"time_offset": find("time_offset")})
        >>> found.save(file)
        >>> mjfish.load_diagnosis(file).summary() == found.summary()
        True
    """
    remedy = "write it by 'mjfish diagnose DATASET --json FILE'"
    content = size_limited.read_json(Path(path), remedy)
    found = content.get("schema") if isinstance(content, dict) and "verdict" in content else None
    if found != SCHEMA:
        told = "is no diagnosis" if found is None else f"has the schema {found!r}"
        raise InputError(f"{path}: {told}, expected one of schema {SCHEMA}; {remedy} of this version")
    if content.get("sha256") != checksummed_json.digest(
        {key: value for key, value in content.items() if key != "sha256"}
    ):
        raise InputError(f"{path}: its content does not fit its hash, expected it as it was written; {remedy}")
    try:
        return _restored(content)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise InputError(f"{path}: has other keys than expected: {error!r}; {remedy} of this version") from None


def _restored(content: Mapping[str, Any]) -> SavedDiagnosis:
    gain = content["gain"]
    plain = {
        **content,
        "setup": {**content["problem"], "dataset": content["dataset"]},
        **content["coefficients"],
        "force": content["missing_force"],
        "gain": gain and _flat({**gain["held_out"], **gain, "by_run": [_flat(run) for run in gain["by_run"]]}),
    }
    own: dict[str, Any] = {"checks": Inspection(restored(tuple[Finding, ...], plain["checks"]["findings"]))}
    own["table"] = table = Table.restored(plain["table"])
    hints = get_type_hints(DiagnosisData)
    names = [entry.name for entry in fields(DiagnosisData) if entry.name not in own]
    found = SavedDiagnosis(content=content, **own, **{name: restored(hints[name], plain[name]) for name in names})
    rows = {row.names: row for row in table.rows}
    candidates = (
        replace(one, row=rows.get((one.name,)) if one.applicable and not one.failure else None)
        for one in found.candidates
    )
    named = (*found.best, *(row.names[0] for row in table.random))  # a learned form goes by its mechanism in the file
    causes = (replace(cause, name=name) for cause, name in zip(found.causes, named, strict=False))
    return replace(found, candidates=tuple(candidates), causes=tuple(causes))


def _flat(gain: Mapping[str, Any]) -> dict[str, Any]:
    """Return a gain with its fields side by side."""
    reduction, speeds = gain.get("relative_reduction", {}), gain["mean_speed_error"]
    told = {"mean_speed_error": (speeds["nominal"], speeds["extended"])}
    return {**gain, **reduction, "relative_reduction": reduction.get("estimate"), **told}
