"""Small drawings for a printed page, as SVG text."""

from collections.abc import Mapping, Sequence
from html import escape

_WIDTH, _HEIGHT, _LEFT, _BELOW = (
    520,
    220,
    46,
    26,
)  # px; chosen: two of them fit beside each other on A4
_DASHES = ("", "7 3", "2 3", "9 3 2 3", "1 4", "12 4")  # lines are told apart without colour
_LETTER_PX = 6.5  # mean width of a letter of size 11
_STEPS = 4  # lines behind the curves


def curves(x: Sequence[float], by_name: Mapping[str, Sequence[float]], limit: float | None) -> str:
    """Lines over an angle in degrees, mm upwards, with a tolerance across."""
    tops = [max(values) for values in by_name.values()] + ([limit] if limit else [])
    top = 1.1 * max(tops, default=1.0) or 1.0
    across, up = (_WIDTH - _LEFT - 10) / (max(x) - min(x) or 1.0), (_HEIGHT - _BELOW - 10) / top

    def place(one: float, value: float) -> str:
        return f"{_LEFT + (one - min(x)) * across:.1f},{_HEIGHT - _BELOW - value * up:.1f}"

    parts = []
    for i in range(_STEPS + 1):
        value = top * i / _STEPS
        at = place(min(x), value).split(",")[1]
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - 10}" y1="{at}" y2="{at}" stroke="#ddd"/>')
        parts.append(f'<text x="4" y="{float(at) + 4:.1f}">{value:.2f}</text>')
    for one in range(int(min(x)), int(max(x)) + 1, 90):
        at = place(one, 0.0).split(",")[0]
        parts.append(f'<text x="{at}" y="{_HEIGHT - 8}">{one}°</text>')
    for i, values in enumerate(by_name.values()):
        points = " ".join(place(*pair) for pair in zip(x, values, strict=True))
        dash = _DASHES[i % len(_DASHES)]
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="#222" stroke-width="1.6" '
            f'stroke-dasharray="{dash}"/>'
        )
    if limit:
        first, last = place(min(x), limit), place(max(x), limit)
        parts.append(f'<polyline points="{first} {last}" stroke="#b3261e" stroke-width="2"/>')
    return _svg(_WIDTH, _HEIGHT, parts) + _key(tuple(by_name))


def shares(by_name: Mapping[str, float]) -> str:
    """Bars of percent, the longest first."""
    ordered = sorted(by_name.items(), key=lambda item: -item[1])
    left = 10 + _LETTER_PX * max((len(name) for name in by_name), default=1)
    width = _WIDTH - left - 60
    parts = []
    for i, (name, share) in enumerate(ordered):
        y = 20 * i
        parts.append(f'<text x="0" y="{y + 14}">{escape(name)}</text>')
        parts.append(
            f'<rect x="{left:.0f}" y="{y + 4}" width="{width * share:.1f}" height="12" fill="#666"/>'
        )
        parts.append(
            f'<text x="{left + width * share + 6:.1f}" y="{y + 14}">{100 * share:.0f} %</text>'
        )
    return _svg(_WIDTH, 20 * len(ordered) + 4, parts)


def _key(names: Sequence[str]) -> str:
    """Which dashes belong to which name."""
    parts = [
        f'<line x1="{90 * i}" x2="{90 * i + 34}" y1="8" y2="8" stroke="#222" stroke-width="1.6" '
        f'stroke-dasharray="{_DASHES[i % len(_DASHES)]}"/><text x="{90 * i + 40}" y="12">{escape(name)}</text>'
        for i, name in enumerate(names)
    ]
    return _svg(90 * len(names), 16, parts)


def _svg(width: float, height: float, parts: Sequence[str]) -> str:
    return f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" role="img">{"".join(parts)}</svg>'
