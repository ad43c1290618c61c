"""From a scene and rays to hits in one call."""

from __future__ import annotations

from harness import tracers
from harness.data import Hits, Rays, Scene
from harness.device.opened import Device, open_device
from harness.inputs.rays import checked
from harness.spec.run_spec import Variant
from harness.spec.structure import StructureSpec, structure_spec
from harness.tracers.prepared import Prepared
from harness.tuning.choose import in_structure


def trace(
    scene: Scene,
    rays: Rays,
    tracer: str = "deferred",
    intersector: str = "ray-space",
    structure: StructureSpec | str = "auto",
    device=None,
    **options,
) -> Hits:
    """First hits of `rays` in `scene`.

    `structure` is a spec (`Uniform`, `Adaptive`), or a text as `8/128` or `adaptive density=0.3`; `auto`, the
    default, chooses it and the deferred tracer's wave and batch by a cost model, which is fitted to the device when
    it is first needed. `device` is an opened Device, a part of a device's name, or None for the default. `options`
    are the tracer's. Raises DefrayError for unknown names, bad rays, a structure that does not fit, or no device.
    """
    kind, prepared = tracers.find(tracer), Prepared(scene)
    variant = Variant(tracer=tracer, intersector=intersector if kind.needs_intersector else None, options=options)
    variant = tracers.check_variant(variant)
    if kind.needs_device:
        device = device if isinstance(device, Device) else open_device(device)
        prepared = Prepared.on_device(scene, device)
    rays = checked(rays)
    if kind.needs_structure:
        prepared, choice = in_structure(prepared, rays, structure_spec(structure), variant)
        variant = choice.chosen_variant(variant) if choice else variant
    return tracers.open_tracer(prepared, variant).timed(rays)[0]
