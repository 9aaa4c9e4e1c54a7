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
    load_fish,
    read,
    shipped,
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
    "load_fish",
    "read",
    "shipped",
]
