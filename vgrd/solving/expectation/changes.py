"""What one change of the cell or of its teaching would give, each computed as the cell itself is."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from vgrd.errors import CalibrationError, InputError
from vgrd.model import CellFacts, Motion, TagSpec
from vgrd.solving.expectation.expectation import Cell, expect

_LARGER = 1.6  # of a tag: from 25 to 40 mm
_NEARER = 0.7  # of the camera: half the depth error
_BORED_MM = 0.02  # as `object.center_sigma_mm` of a centre that was measured (docs/cell-file.md)


@dataclass(frozen=True, slots=True)
class Change:
    """words: what is changed, from and to; u95_mm: of the worst target after it."""

    words: str
    u95_mm: float


def changes_of(cell: Cell) -> list[Change]:
    """What to change first comes first; what cannot be is left out."""
    changes = []
    for words, changed in _changed(cell):
        try:
            changes.append(Change(words, expect(changed).worst_mm))
        except (CalibrationError, InputError):  # such as a camera too near for tag A
            continue
    return sorted(changes, key=lambda change: change.u95_mm)


def _changed(cell: Cell) -> Iterator[tuple[str, Cell]]:
    yield from _of_parts(cell)
    yield from _of_teaching(cell)


def _of_parts(cell: Cell) -> Iterator[tuple[str, Cell]]:
    """What is bought, printed or measured."""
    facts, assumed = cell.facts, cell.assumed
    a, b = facts.tag_a, _larger(facts.tag_b)
    words = f"tag B {b.size_mm:g} mm instead of {facts.tag_b.size_mm:g} mm"
    yield words, _with(cell, replace(facts, tag_b=b))
    if a is not None:
        larger = _larger(a)
        words = f"tag A {larger.size_mm:g} mm instead of {a.size_mm:g} mm"
        yield words, _with(cell, replace(facts, tag_a=larger))
    nearer = float(round(_NEARER * assumed.distance_mm / 10) * 10) or assumed.distance_mm
    words = f"camera at {nearer:g} mm instead of {assumed.distance_mm:g} mm"
    yield words, replace(cell, assumed=replace(assumed, distance_mm=nearer))
    words = f"an arm good to {cell.arm_mm / 2:g} mm instead of {cell.arm_mm:g} mm"
    yield words, replace(cell, assumed=replace(assumed, arm_mm=cell.arm_mm / 2))
    sigma_mm = facts.tag_b_sigma_mm
    if sigma_mm > 0:
        half = replace(facts, tag_a_sigma_mm=facts.tag_a_sigma_mm / 2, tag_b_sigma_mm=sigma_mm / 2)
        words = f"edges of the tags measured to {sigma_mm / 2:g} mm instead of {sigma_mm:g} mm"
        yield words, _with(cell, half)
    percent = assumed.focal_percent
    if percent > 0:
        words = f"focal length known to {percent / 2:g} % instead of {percent:g} %"
        yield words, replace(cell, assumed=replace(assumed, focal_percent=percent / 2))
    yield from _of_object(cell)


def _of_object(cell: Cell) -> Iterator[tuple[str, Cell]]:
    spec = cell.facts.object
    has_center = spec.motion is Motion.TURNTABLE and spec.center_in_object is not None
    if has_center and spec.center_sigma_mm > _BORED_MM:
        words = f"center_mm measured to {_BORED_MM:g} mm instead of {spec.center_sigma_mm:g} mm"
        known = replace(spec, center_sigma_mm=_BORED_MM)
        yield words, _with(cell, replace(cell.facts, object=known))
    if spec.has_cad and spec.cad_sigma_mm > 0:
        half = replace(spec, cad_sigma_mm=spec.cad_sigma_mm / 2)
        words = (
            f"targets in CAD good to {half.cad_sigma_mm:g} mm instead of {spec.cad_sigma_mm:g} mm"
        )
        yield words, _with(cell, replace(cell.facts, object=half))


def _of_teaching(cell: Cell) -> Iterator[tuple[str, Cell]]:
    """What the operator does."""
    assumed, (lateral, axial) = cell.assumed, cell.touch_sigmas_mm
    words = f"touches good to {lateral / 2:g} mm instead of {lateral:g} mm"
    yield words, replace(cell, touch_sigmas_mm=(lateral / 2, axial / 2))
    for name in ("touches", "looks", "spins"):
        count = getattr(assumed, name)
        if not count:
            continue
        more = {name: 2 * count}
        if name == "touches":
            more |= {"turned": 2 * assumed.turned, "tilted": 2 * assumed.tilted}
        words = f"{2 * count} {name} instead of {count}"
        yield words, replace(cell, assumed=replace(assumed, **more))

    least = max(1, len(cell.facts.object.bare))  # as the tool works
    if assumed.tilted and assumed.touches - assumed.turned - 2 * assumed.tilted >= least:
        words = f"{2 * assumed.tilted} of the touches tilted instead of {assumed.tilted}"
        yield words, replace(cell, assumed=replace(assumed, tilted=2 * assumed.tilted))


def _with(cell: Cell, facts: CellFacts) -> Cell:
    return replace(cell, facts=facts)


def _larger(tag: TagSpec) -> TagSpec:
    return replace(tag, size_mm=float(round(_LARGER * tag.size_mm)))
