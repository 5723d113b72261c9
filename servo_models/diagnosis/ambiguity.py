"""What a confidence set leaves open, told as choices: "a load and a friction", not a flat list.

Fitted models that differ by one effect exchange it: where one has a constant load the other has
gravity, and the rest stays.  Effects that exchange for each other, directly or over others, are one
slot.  Fitted models that are linked by such exchanges take the same number of effects from each
slot, since an exchange stays within one; those that are not linked are alternatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

Effects = tuple[str, ...]
T = TypeVar("T")


@dataclass(frozen=True)
class Slot:
    """Effects that exchange for each other while the rest stays.

    Attributes:
        effects: their names, in the order of the fitted models.
        count: how many of them each fitted model has, nearly always one.
        family: what all of them are, such as "friction"; "" where they are of several families.
    """

    effects: Effects
    count: int
    family: str = ""

    @property
    def open(self) -> bool:
        """Whether there is a choice."""
        return len(self.effects) > self.count

    def __str__(self) -> str:
        *most, last = self.effects
        if not self.open:
            return f"{', '.join(most)} and {last}" if most else last
        if self.count > 1:
            return f"{self.count} of {', '.join(most)} and {last}"
        choice = f"{', '.join(most)} or {last}"
        article = "an" if self.family[:1] in "aeiou" else "a"
        return f"{article} {self.family} ({choice})" if self.family else f"one of {choice}"


def alternatives(
    models: Iterable[Effects], family: Callable[[str], str]
) -> tuple[tuple[Slot, ...], ...]:
    """Return the slots of each group of fitted models that exchanges link, likeliest first.

    Args:
        models: effects of each fitted model, likeliest first.
        family: word for what an effect is, "" for none.
    """
    told = list(models)
    return tuple(_slots(group, family) for group in _linked(told, _exchange)) if told else ()


def _exchange(first: Effects, second: Effects) -> bool:
    """Whether one effect exchanges for another while the rest stays."""
    return len(first) == len(second) and len({*first} - {*second}) == 1


def _slots(models: Sequence[Effects], family: Callable[[str], str]) -> tuple[Slot, ...]:
    pairs = {frozenset({*a} ^ {*b}) for a in models for b in models if _exchange(a, b)}
    names = list(dict.fromkeys(name for effects in models for name in effects))
    groups = _linked(names, lambda a, b: frozenset((a, b)) in pairs)
    return tuple(
        Slot(tuple(group), len({*group} & {*models[0]}), words.pop() if len(words) == 1 else "")
        for group in groups
        for words in [{family(name) for name in group}]
    )


def _linked(items: Sequence[T], link: Callable[[T, T], bool]) -> list[list[T]]:
    """Items in groups: those linked directly or over others, each in the order given."""
    labels = [*range(len(items))]
    for i, j in combinations(range(len(items)), 2):
        if link(items[i], items[j]):
            first, second = sorted((labels[i], labels[j]))
            labels = [first if label == second else label for label in labels]
    groups: dict[int, list[T]] = {}
    for label, item in zip(labels, items):
        groups.setdefault(label, []).append(item)
    return list(groups.values())
