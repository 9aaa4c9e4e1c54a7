"""Write docs/schemas.md: the keys of the JSON Schemas in mjfish/schemas, each with its description.

python tools/schema_page.py
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[1]
SCHEMAS = _ROOT / "mjfish" / "schemas"
PAGE = _ROOT / "docs" / "schemas.md"

_HEAD = """\
# Schemas

<!-- Written by tools/schema_page.py from mjfish/schemas. -->

What mjfish reads and writes for other programs has a [JSON Schema](https://json-schema.org), draft 2020-12. The schemas
are in the package, one file a version:

```python
import json
from importlib.resources import files

schema = json.loads((files("mjfish") / "schemas" / "diagnosis-5.json").read_text(encoding="utf-8"))
print(schema["$id"])
```

- The key `schema` of a file is the version of its schema. The version rises when a key changes its meaning or goes.
  A key that is added leaves it, so check a file against the schema of the mjfish that wrote it.
- A key in these tables that is not *optional* is always there. `[]` stands for each entry of a list, `*` for any name.
- mjfish itself checks more than a schema can say, for instance that a recording is not named twice, and says what to
  correct.
"""


def page() -> str:
    """Return the page as text."""
    return "\n".join([_HEAD, *(_section(json.loads(file.read_text(encoding="utf-8"))) for file in files())])


def files() -> list[Path]:
    """Return the files of the schemas, by name."""
    return sorted(SCHEMAS.glob("*.json"))


def _section(schema: dict[str, Any]) -> str:
    lines = [f"## {schema['title']}", "", f"`{schema['$id']}`. {schema['description']}", "", *_table(schema)]
    for name, part in schema["$defs"].items():
        lines += [f"### {name} in {schema['title']}", "", part["description"], ""]
        lines += _table(part) if list(_rows(part, "", required=True)) else []
    return "\n".join(lines)


def _table(schema: dict[str, Any]) -> list[str]:
    rows = [f"| {cells} |" for cells in _rows(schema, "", required=True)]
    return ["| key | value | meaning |", "|---|---|---|", *rows, ""]


def _rows(schema: dict[str, Any], path: str, *, required: bool) -> Iterator[str]:
    """Yield one row for this schema, where it has a path, and rows for all below it."""
    if path:
        optional = "" if required else "*optional*; "
        yield f"`{path}` | {optional}{_kind(schema)} | {schema.get('description', '').replace('|', chr(92) + '|')}"
    for part in [schema, *schema.get("anyOf", []), *schema.get("oneOf", [])]:
        needed = part.get("required", [])
        for name, below in {**part.get("properties", {}), **_any_name(part)}.items():
            yield from _rows(below, f"{path}.{name}" if path else name, required=name in needed or name == "*")
        if _has_keys(part.get("items", {})):
            for row in _rows(part["items"], f"{path}[]", required=True):
                if not row.startswith(f"`{path}[]`"):
                    yield row


def _any_name(schema: dict[str, Any]) -> dict[str, Any]:
    below = schema.get("additionalProperties")
    return {"*": below} if isinstance(below, dict) and _has_keys(below) else {}


def _has_keys(schema: dict[str, Any]) -> bool:
    return any("properties" in part for part in [schema, *schema.get("anyOf", [])])


def _kind(schema: dict[str, Any]) -> str:
    """Return in words what a value may be."""
    if "$ref" in schema:
        return f"*{schema['$ref'].rsplit('/', 1)[1]}*"
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    for several in ("anyOf", "oneOf"):
        if several in schema:
            return " or ".join(dict.fromkeys(_kind(part) for part in schema[several]))
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    return " or ".join(_plain_kind(kind, schema) for kind in kinds)


def _plain_kind(kind: str, schema: dict[str, Any]) -> str:
    if kind == "array":
        return f"list of {_kind(schema['items'])}"
    if kind == "object":
        below = schema.get("additionalProperties")
        return f"table, {_kind(below)} by name" if isinstance(below, dict) else "table"
    return {"string": "text", "boolean": "true or false", "integer": "whole number"}.get(kind, kind)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
