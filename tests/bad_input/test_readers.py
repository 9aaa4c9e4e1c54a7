"""Whatever happens to a file, reading it ends in finite numbers or in a message, soon, and without a warning."""

from __future__ import annotations

import resource
from collections import Counter
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from readers import NAMES, Reader

#: Inputs of a reader that are tried in every run, and in the long ones.
FEW, MANY = 25, 10_000
#: Most that all of them may take [bytes].
MEMORY = 500 * 10**6


@pytest.fixture(scope="module", params=NAMES)
def reader(request: pytest.FixtureRequest, known: dict[str, Reader]) -> Reader:
    return known[request.param]


def test_every_reader_reads_its_valid_file(reader: Reader, tmp_path: Path) -> None:
    reader.prepare(tmp_path)
    assert reader.outcome(reader.valid, tmp_path) == "read"


def _tried(reader: Reader, folder: Path, inputs: int, **options: object) -> Counter[str]:
    counts: Counter[str] = Counter()
    reader.prepare(folder)

    @settings(max_examples=inputs, deadline=None, database=None, suppress_health_check=list(HealthCheck), **options)
    @given(st.randoms(use_true_random=False))
    def ends_well(random: Random) -> None:
        counts[reader.outcome(reader.mutated(random), folder)] += 1

    ends_well()
    return counts


def test_a_few_mutated_files_are_read_or_refused(reader: Reader, tmp_path: Path) -> None:
    _tried(reader, tmp_path, FEW, derandomize=True)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_many_mutated_files_are_read_or_refused(reader: Reader, tmp_path: Path) -> None:
    """By a generator of its own: hypothesis keeps to small choices, and slows down with their number."""
    reader.prepare(tmp_path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    counts = Counter(reader.outcome(reader.mutated(Random(k)), tmp_path) for k in range(MANY))  # noqa: S311
    assert counts["refused"] > MANY // 10
    assert counts["read"] > 0
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < MEMORY
