"""What space is cut into: one structure a file, found by listing this folder and those of DEFRAY_EXTRA."""

from __future__ import annotations

from harness.errors import known
from harness.files import files_of, module_of
from harness.spec.structure import OVERLAPS, StructureSpec
from harness.structures.contract import Structure
from harness.structures.device_scene import DeviceScene


def _classes() -> dict[str, type[Structure]]:
    modules = (module_of("structures", file) for file in files_of("structures"))
    found = (getattr(module, "STRUCTURE", None) for module in modules)
    return {structure.name: structure for structure in found if structure}


def names() -> list[str]:
    """Names of all structures."""
    return sorted(_classes())


def find(name: str) -> type[Structure]:
    """The structure called `name`; raises DefrayError listing the known ones."""
    if name not in _classes():
        raise known("structure", name, [*names(), "auto"])
    return _classes()[name]


def check_structure(spec: StructureSpec) -> StructureSpec:
    """`spec` itself, its structure known and its options valid; raises DefrayError."""
    find(spec.name).options(spec)
    return spec


def build(scene: DeviceScene, spec: StructureSpec, overlap: str = "padded") -> Structure:
    """Build what `spec` asks for; raises DefrayError for a bad spec or one that needs too much memory.

    `overlap`: "padded", the default, is a closed separating-axis test with cells grown by a few ulp; "closed" the
    same without, "open" with strict inequalities, "box" the bounding box rounded down. Only the first loses no ray.
    """
    if overlap not in OVERLAPS:
        raise known("overlap test", overlap, OVERLAPS)
    return find(spec.name).build(scene, spec, overlap)
