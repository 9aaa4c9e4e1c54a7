"""Results of a test as plain data, for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np


class Plain:
    """A record whose fields are numbers, words and arrays."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {key: v.tolist() if isinstance(v, np.ndarray) else v for key, v in vars(self).items()}
