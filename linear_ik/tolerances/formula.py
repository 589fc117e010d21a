"""Formula: the little arithmetic of limits, such as ``max(L/1000, 3 mm)``.

    sum     = product (("+" | "-") product)*
    product = factor (("*" | "/") factor)*
    factor  = "-" factor | number [unit] | name | function "(" sum ("," sum)* ")" | "(" sum ")"

A number takes its unit before anything else: ``10 ft`` is one value. Every value knows its power of
length, so that ``L/1000 + 3`` is an error and not three metres. Nothing else is understood,
Python's own syntax least of all.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from linear_ik.errors import ToleranceError

# name -> metres or radians, power of length
UNITS: dict[str, tuple[float, int]] = {
    "mm": (1e-3, 1),
    "cm": (1e-2, 1),
    "m": (1.0, 1),
    "in": (0.0254, 1),
    "ft": (0.3048, 1),
    "deg": (math.pi / 180.0, 0),
    "rad": (1.0, 0),
}
FUNCTIONS = ("max", "min", "floor", "ceil")
LONGEST, DEEPEST = 200, 20  # characters, brackets: no standard's limit comes near, and a file may be anybody's
EXPECTED = "numbers with units (3 mm), L, h, D, B, + - * /, brackets, " + ", ".join(FUNCTIONS)
_TOKEN = re.compile(r"\s*(?:(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\.\d+)|([A-Za-z_]+)|([-+*/(),]))")


@dataclass(frozen=True)
class Quantity:
    """A value and its unit.

    Attributes:
        value: in metres to the power, or a plain number or angle.
        power: of length.
    """

    value: float
    power: int = 0


def evaluate(text: str, names: Mapping[str, Quantity]) -> Quantity:
    """Return what a formula comes to.

    Args:
        text: the formula.
        names: what its names stand for.

    Raises:
        ToleranceError: said of "formula": something that is none, an unknown name, units that do
            not go together, a division by zero.
    """
    if len(text) > LONGEST:
        raise ToleranceError("formula", f"{len(text)} characters", f"at most {LONGEST}")
    reader = _Reader(text, names)
    found = reader.sum(0)
    reader.end()
    if not math.isfinite(found.value):
        raise ToleranceError("formula", f"{text!r}: larger than any number", EXPECTED)
    return found


class _Reader:
    def __init__(self, text: str, names: Mapping[str, Quantity]) -> None:
        self._text, self._names = text, names
        self._tokens: list[tuple[str, str]] = []
        at = 0
        while at < len(text.rstrip()):
            match = _TOKEN.match(text, at)
            if match is None:
                raise self._wrong(f"{text[at:].strip()[:10]!r} is not understood")
            kinds = ("number", "name", "sign")
            self._tokens += [(kind, part) for kind, part in zip(kinds, match.groups(), strict=True) if part]
            at = match.end()
        self._tokens.append(("end", ""))
        self._at = 0

    def sum(self, depth: int) -> Quantity:
        if depth > DEEPEST:
            raise self._wrong("brackets within brackets, too many")
        left = self._product(depth)
        while self._peek() in ("+", "-"):
            sign = 1.0 if self._take() == "+" else -1.0
            right = self._product(depth)
            self._alike([left, right])
            left = Quantity(left.value + sign * right.value, left.power)
        return left

    def end(self) -> None:
        if self._tokens[self._at][0] != "end":
            raise self._wrong(f"{self._peek()!r} is one too many")

    def _product(self, depth: int) -> Quantity:
        left = self._factor(depth)
        while self._peek() in ("*", "/"):
            if self._take() == "*":
                right = self._factor(depth)
                left = Quantity(left.value * right.value, left.power + right.power)
            else:
                right = self._factor(depth)
                if right.value == 0.0:
                    raise self._wrong("a division by zero")
                left = Quantity(left.value / right.value, left.power - right.power)
        return left

    def _factor(self, depth: int) -> Quantity:
        kind, text = self._tokens[self._at]
        if kind == "end":
            raise self._wrong("something is missing at its end")
        self._at += 1
        if kind == "number":
            factor, power = UNITS[self._take()] if self._peek() in UNITS else (1.0, 0)
            return Quantity(float(text) * factor, power)
        if text == "-":
            if depth > DEEPEST:
                raise self._wrong("too many signs")
            value = self._factor(depth + 1)
            return Quantity(-value.value, value.power)
        if text == "(":
            value = self.sum(depth + 1)
            self._expect(")")
            return value
        if kind == "name" and text in FUNCTIONS:
            return self._call(text, depth)
        if kind == "name" and text in self._names:
            return self._names[text]
        raise self._wrong(f"{text!r} is not known" if kind == "name" else f"{text!r} is out of place")

    def _call(self, name: str, depth: int) -> Quantity:
        self._expect("(")
        values = [self.sum(depth + 1)]
        while self._peek() == ",":
            self._take()
            values.append(self.sum(depth + 1))
        self._expect(")")
        if name in ("floor", "ceil"):
            if len(values) != 1 or values[0].power or not math.isfinite(values[0].value):
                raise self._wrong(f"{name} takes one plain number, such as L / 3 m")
            whole: Callable[[float], int] = math.floor if name == "floor" else math.ceil
            # A length that is three times 3 m up to rounding is exactly that.
            return Quantity(float(whole(round(values[0].value, 9))))
        self._alike(values)
        pick: Callable[[list[float]], float] = max if name == "max" else min
        return Quantity(pick([v.value for v in values]), values[0].power)

    def _alike(self, values: list[Quantity]) -> None:
        if len({v.power for v in values}) > 1:
            raise self._wrong("a length and a plain number do not go together: is a unit missing?")

    def _peek(self) -> str:
        return self._tokens[self._at][1]

    def _take(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1][1]

    def _expect(self, sign: str) -> None:
        if self._peek() != sign:
            raise self._wrong(f"{sign!r} is missing")
        self._at += 1

    def _wrong(self, what: str) -> ToleranceError:
        return ToleranceError("formula", f"{self._text!r}: {what}", EXPECTED)
