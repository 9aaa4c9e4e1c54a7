"""The fish: its body, frames and outline, its file, and what is known of its numbers."""

from mjfish.fish.fish import (
    KINDS,
    ByGroup,
    Coefficient,
    Coefficients,
    Cpg,
    Fish,
    Link,
    NotNegative,
    Section,
    Servo,
    fish_text,
    load_fish,
    read,
    shipped,
    write_fish,
)

__all__ = [
    "KINDS",
    "ByGroup",
    "Coefficient",
    "Coefficients",
    "Cpg",
    "Fish",
    "Link",
    "NotNegative",
    "Section",
    "Servo",
    "fish_text",
    "load_fish",
    "read",
    "shipped",
    "write_fish",
]
