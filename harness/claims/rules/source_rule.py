"""Operations of a ray/triangle test, counted in its kernel's source."""

from __future__ import annotations

import re
from typing import Literal

from harness.claims.operands import Evidence
from harness.claims.outcome import Finding, Outcome, missing
from harness.data import Strict
from harness.errors import DefrayError
from harness.spec.intersectors import KERNELS, find

DOT_FLOPS, CROSS_FLOPS = 5, 9  # of three terms: products and sums


class Rule(Strict):
    """The paper's tally of a test; a dot product is three products and two sums, a cross product six and three."""

    type: Literal["source"]
    intersector: str
    differences: int
    dot_products: int
    cross_products: int

    @property
    def flops(self) -> int:
        """Operations that the tally makes."""
        return self.differences + DOT_FLOPS * self.dot_products + CROSS_FLOPS * self.cross_products

    def judge(self, evidence: Evidence) -> Outcome:
        """Products and sums in the source, to accept or reject, against the tally."""
        tally = (
            f"{self.differences} differences, {self.dot_products} dot products, {self.cross_products} cross "
            f"product: {self.flops} operations"
        )
        entry = find(self.intersector)
        try:
            products, sums = operations((KERNELS / "intersect" / entry.file).read_text(encoding="utf-8"))
        except (OSError, DefrayError) as error:
            return missing(f"the source of {self.intersector} cannot be counted: {error}", tally)
        expected = 3 * self.dot_products + 6 * self.cross_products
        answer = products == expected and sums == self.flops - expected
        note = f"{products} products and {sums} sums or differences in kernels/intersect/{entry.file}"
        total = products + sums
        finding = Finding("operations of a test", total, total, total, answer=answer, note=note)
        return Outcome(answer, answer, tally, [finding], f"{total} operations", needed=f"{self.flops} operations")


def operations(source: str) -> tuple[int, int]:
    """Products, and sums or differences, of `intersector_test` before its first branch.

    The source must write them out, without fma and without calls but of min and max. Raises DefrayError otherwise.
    """
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", source, flags=re.DOTALL)
    match = re.search(r"intersector_test\([^)]*\)\s*\{(.*?)\bif\s*\(", text, flags=re.DOTALL)
    if not match:
        raise DefrayError("it has no intersector_test with a branch after acceptance")
    body = match[1].replace("->", ".")
    calls = set(re.findall(r"\b([a-z_]+)\s*\(", body)) - {"min", "max"}
    if calls:
        raise DefrayError(f"it calls {', '.join(sorted(calls))}")
    return len(re.findall(r"\*", body)), len(re.findall(r"(?<=[\w)\s])\s[+-]\s", body))
