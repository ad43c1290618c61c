"""Runs an intersector's C as Python, on numbers that count their operations by the rule of intersect.clh."""

from __future__ import annotations

import re
from types import SimpleNamespace

from harness.spec.intersectors import KERNELS


class Counted(float):
    """A float that adds to `flops` for each + - * and division."""

    flops = 0

    def _count(self, value: float, flops: int = 1) -> Counted:
        Counted.flops += flops
        return Counted(value)

    def __add__(self, other):
        return self._count(float(self) + float(other))

    def __sub__(self, other):
        return self._count(float(self) - float(other))

    def __mul__(self, other):
        return self._count(float(self) * float(other))

    def __truediv__(self, other):
        return self._count(float(self) / float(other))

    def __neg__(self):
        return Counted(-float(self))

    __radd__, __rmul__ = __add__, __mul__


def fused(a, b, c) -> Counted:
    """fma: two flops."""
    return Counted(0.0)._count(float(a) * float(b) + float(c), 2)


def products(a, b, c, d) -> Counted:
    """difference_of_products: six flops."""
    return Counted(0.0)._count(float(a) * float(b) - float(c) * float(d), 6)


FREE = {
    "fma": fused,
    "difference_of_products": products,
    "fabs": lambda x: Counted(abs(float(x))),
    "pick": lambda no, yes, m: yes if m else no,
    "mask_any": bool,
    "mask_not": lambda m: not m,
    "min": lambda a, b: Counted(min(float(a), float(b))),
    "max": lambda a, b: Counted(max(float(a), float(b))),
    "copysign": lambda a, b: Counted(abs(float(a)) if float(b) >= 0 else -abs(float(a))),
    "sqrt": lambda x: Counted(float(x) ** 0.5),
    "struct": SimpleNamespace,
    "LEAST_DETERMINANT": 0.0,
    "EDGE_TOLERANCE": Counted(0),
}


def functions_of(file: str) -> dict:
    """The functions of kernels/intersect/`file`, which may use reals, masks, structs and calls, but no loops."""
    text = (KERNELS / "intersect" / file).read_text()
    text = re.sub(r'^#include "(.*)"$', lambda found: (KERNELS / found[1]).read_text(), text, flags=re.MULTILINE)
    text = re.sub(r"//.*", "", text)
    text = re.sub(r"^\s*#.*$", "", text, flags=re.MULTILINE)
    names = dict(FREE)
    text = re.sub(r"\{ (return .*;) \}$", r"{ \1\n}", text, flags=re.MULTILINE)
    for name, arguments, body in re.findall(
        r"^(?:inline|cold_path) \w+ (\w+)\(([^)]*)\)\s*\{(.*?)^\}", text, flags=re.MULTILINE | re.DOTALL
    ):
        parameters = ", ".join(re.findall(r"(\w+)\s*(?:,|$)", arguments))
        lines = [line for statement in body.split(";") for line in statement_as_python(" ".join(statement.split()))]
        exec(f"def {name}({parameters}):\n" + "".join(f"    {line}\n" for line in lines or ["pass"]), names)
    return names


def statement_as_python(text: str) -> list[str]:
    """One C statement without its semicolon as lines of Python."""
    if not text:
        return []
    text = re.sub(r"(\d)f\b", r"\1", text.replace("->", ".").replace("(real)", "").replace("(&", "("))
    found = re.match(r"if \(!mask_any\((\w+)\)\) return", text)
    if found:
        return [f"if not {found[1]}: return {found[1]}"]
    declared = re.match(r"(?:const )?(real|mask|Frame|Across|Sheared) (.*)$", text)
    if not declared:
        return [re.sub(r"^\*", "", part) for part in split(text)]
    kind, names = declared.groups()
    lines = []
    for part in split(names):
        room = re.match(r"^(\w+)\[(\d+)\]$", part)
        empty = f"{part} = struct()" if kind not in ("real", "mask") else f"{part} = None"
        lines.append(part if "=" in part else f"{room[1]} = [None] * {room[2]}" if room else empty)
    return lines


def split(text: str) -> list[str]:
    """Parts between commas outside brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def flops_of_a_miss(file: str) -> int:
    """Flops that the test takes to reject one triangle; raises AssertionError should it be hit."""
    functions = functions_of(file)
    ray_values = dict(ox=0, oy=0, oz=0, dx=0.25, dy=0.5, dz=1)
    corners = dict(x0=5, y0=4, z0=3, x1=6, y1=4, z1=2, x2=5, y2=7, z2=2.5)
    real = {name: Counted(value) for name, value in (ray_values | corners).items()}
    ray = SimpleNamespace(**{name: real[name] for name in ray_values})
    frame = functions["intersector_setup"](ray)
    Counted.flops = 0
    assert not functions["intersector_test"](frame, SimpleNamespace(**real), None, None, None)
    return Counted.flops
