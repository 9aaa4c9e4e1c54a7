"""Reading a sensor: its entry in dataset.toml and its table of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjfish.data import columns
from mjfish.data.dataset_toml import SensorTable
from mjfish.data.sensor import CHANNELS_OF, ON_HEAD, PLACED, Sensor, cleaned
from mjfish.data.sheet import read_sheet
from mjfish.data.tables import read_table
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray


def read_sensor(entry: SensorTable, fish: Fish, source: Path, key: str) -> Sensor:
    """Read the file of a sensor and validate it.

    Args:
        entry: of ``[[trials.sensors]]``.
        fish: that carries it.
        source: its file.
        key: of the entry in dataset.toml, for messages.

    Raises:
        InputError: a file, column, place or number that is not what it must be.
        UnknownNameError: a header that the file does not have.
    """
    wanted = ("time", *CHANNELS_OF[entry.kind])
    if not entry.columns:
        return build_sensor(entry, read_table(source, missing=wanted[1:]), fish, source, key)
    unnamed = [name for name in wanted if name not in entry.columns]
    unknown = [name for name in entry.columns if name not in wanted]
    if unnamed or unknown:
        raise InputError(
            f"{key}.columns: {', '.join(map(repr, unknown or unnamed))} {'unknown' if unknown else 'missing'}, "
            f"expected the header of each of {', '.join(wanted)}; correct it"
        )
    sheet = read_sheet(source)
    numbers = {name: sheet.numbers(entry.columns[name], missing=name != "time") for name in wanted}
    return build_sensor(entry, numbers, fish, source, key, sheet.layout.first_line)


def build_sensor(
    entry: SensorTable,
    numbers: Mapping[str, FloatArray],
    fish: Fish,
    source: Path,
    key: str,
    first_line: int | None = None,
) -> Sensor:
    """Put a sensor together from its entry and its columns by name.

    Args:
        entry: see `read_sensor`.
        numbers: columns (n,) by name; the time increases.
        fish: see `read_sensor`.
        source: its file.
        key: see `read_sensor`.
        first_line: of the numbers in the file, see `row_name`.

    Raises:
        InputError: as `read_sensor`.
    """
    channels, (link, station) = CHANNELS_OF[entry.kind], _place(entry, fish, key)
    for name in ("time", *channels):
        if name not in numbers:
            found = ", ".join(map(columns.header, numbers))
            raise InputError(
                f"{source}: column '{columns.header(name)}' is missing; found {found}; add it, or say in {key}.columns "
                "which header it has"
            )
    if entry.sigma and len(entry.sigma) != len(channels):
        raise InputError(
            f"{key}.sigma: {len(entry.sigma)} numbers, expected one for each of {', '.join(channels)}; "
            "correct it, or leave it out to have it estimated"
        )
    sensor = Sensor(
        name=entry.label,
        kind=entry.kind,
        time=numbers["time"],
        values=np.stack([numbers[name] for name in channels], axis=1),
        link=link,
        station=station,
        placed=entry.place is None or entry.place.known,
        sigma=np.array(entry.sigma) if entry.sigma else None,
        free_clock=entry.clock == "free",
        source=source,
    )
    return cleaned(sensor, source, first_line)


def _place(entry: SensorTable, fish: Fish, key: str) -> tuple[int, float]:
    """Return link and station of a sensor."""
    names = [link.name for link in fish.links]
    if entry.place is None:
        if entry.kind in PLACED:
            raise InputError(
                f"{key}.place: missing, expected where the {entry.kind} sits, for its reading depends on it; add "
                f'place = {{link = "{names[0]}", station = 0.0}}, the station in m behind the front of the link'
            )
        return 0, 0.0
    if entry.place.link not in names:
        raise InputError(
            f"{key}.place.link: no link '{entry.place.link}' in fish '{fish.name}', expected one of "
            f"{', '.join(names)}; correct it"
        )
    link, station = names.index(entry.place.link), entry.place.station
    if entry.kind in ON_HEAD and link > 0:
        raise InputError(
            f"{key}.place.link: '{entry.place.link}', expected '{names[0]}', for a {entry.kind} is predicted on the "
            "head only; leave the sensor out"
        )
    if station > fish.links[link].length:
        raise InputError(
            f"{key}.place.station: {station:g} m is off the link '{names[link]}', which is "
            f"{fish.links[link].length:g} m long; correct it, or name the link behind"
        )
    return link, station
