"""The report as one HTML file: no script, nothing from elsewhere, black on white for a printer."""

import time
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, Final

import vgrd
from vgrd.reporting.drawings import curves, shares
from vgrd.reporting.session import SessionReport

_STYLE: Final = """
body{font:14px/1.4 system-ui,sans-serif;color:#111;background:#fff;max-width:190mm;margin:8mm auto;padding:0 4mm}
h1{font-size:22px;margin:0}h2{font-size:15px;margin:14px 0 4px;border-bottom:1px solid #999}
.verdict{font-size:26px;font-weight:700;border:3px solid;padding:6px 12px;margin:8px 0}
.bad{color:#b3261e}table{border-collapse:collapse;width:100%}td,th{text-align:left;padding:2px 8px 2px 0;
border-bottom:1px solid #ddd;vertical-align:top}svg{font:11px system-ui,sans-serif;max-width:100%;height:auto}
img{max-width:100%}td{overflow-wrap:anywhere}section{break-inside:avoid}
@media print{body{margin:0}@page{size:A4;margin:12mm}}
"""
_GOES: Final[Mapping[str, str]] = {"go": "✔ GO", "no go": "✖ NO GO", "open": "○ NOT VERIFIED YET"}


def report_page(report: SessionReport) -> str:
    """The whole page."""
    header, result = report.session.header, report.result
    is_good = bool(result["verdict"]["ok"])
    word = "✔ ACCEPTED" if is_good else "✖ REJECTED"
    limit = result.get("tolerance_mm")
    facts = [
        (
            "object",
            f"{len(header.facts.object.targets)} targets, motion {header.facts.object.motion.value}",
        ),
        ("plan", header.plan.value),
        ("begun", _when(header.created_unix_s)),
        ("solved", _when(result["solved_unix_s"])),
        (
            "tolerance",
            "none was given" if limit is None else f"{limit:g} mm for 95 % of the misses",
        ),
        (
            "calibration",
            f"{result['calibration'] or 'none was stored'}; {report.activated or 'kept nowhere'}",
        ),
        ("samples", _counts(report)),
        ("operator", _minutes(report.minutes)),
        ("made by", f"vgrd {vgrd.__version__}"),
    ]
    checked = result["verification"]
    parts = [
        f"<h1>Calibration report: session {escape(header.name)}</h1>",
        f'<p class="verdict{"" if is_good else " bad"}">{word}</p>',
        f"<p>{escape(result['good'])}. {_limits(result)}</p>",
        _section("What and when", _table((), facts)),
        _section(
            f"Verification: {_GOES[checked['verdict']]}",
            f"<p>{escape(checked['words'])}</p>" + _checks(checked),
        ),
        _section("What was found", _table(("finding", "what it says"), _findings(result))),
        *_figures(result, limit),
        _picture(report),
        _section("Hashes (sha256)", _table((), list(report.hashes.items()))),
    ]
    title = f"Calibration report {escape(header.name)}"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>"
    )


def _figures(result: Mapping[str, Any], limit: float | None) -> list[str]:
    """What only the joint estimate can tell."""
    parts = []
    if budget := result.get("budget"):
        drawn = shares(budget["means"])
        parts.append(_section("Where the error comes from (share of the variance)", drawn))
    if predicted := result.get("map"):
        parts.append(
            _section(
                "Predicted 95 % error, mm, over the object's turn since it was touched",
                curves(predicted["angles_deg"], predicted["u95_mm"], limit),
            )
        )
    if levels := result.get("levels"):
        keys = ("noise", "stated", "found", "unit")
        cells = [[_text(level[key]) for key in keys] for level in levels]
        parts.append(
            _section(
                "Noise, one sigma: as the cell file states it, as it was found",
                _table(keys, cells),
            )
        )
    if touches := result.get("touches"):
        keys = ("touch", "off, mm", "from where the others put it, mm", "suspect")
        cells = [
            [_text(one[key]) for key in ("name", "off_mm", "left_out_mm", "reason")]
            for one in touches
        ]
        parts.append(_section("Touches", _table(keys, cells)))
    return parts


def _limits(result: Mapping[str, Any]) -> str:
    words = [f"It is limited by {result['limits']}" * bool(result["limits"]), result["add"]]
    return escape(". To make it better: ".join(word for word in words if word))


def _findings(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    found = [(one["code"], one["message"]) for one in result["verdict"]["findings"]]
    return found + [("warning", words) for words in result["warnings"]]


def _checks(checked: Mapping[str, Any]) -> str:
    rows = [
        (
            one["target"],
            _text(one["off_mm"]),
            "yes" if one["counts"] else "no: not turned by 60 degrees",
            _trouble(one),
        )
        for one in checked["verifications"]
    ]
    return _table(("target", "off, mm", "counts", "result"), rows) if rows else ""


def _trouble(one: Mapping[str, Any]) -> str:
    return one["trouble"] or ("✖ more than chance allows" if one["fails"] else "✔ as predicted")


def _picture(report: SessionReport) -> str:
    if not report.picture:
        return ""
    source = f"data:image/jpeg;base64,{report.picture}"
    return _section("First picture", f'<img alt="first picture of the session" src="{source}">')


def _counts(report: SessionReport) -> str:
    counts = [
        f"{len(numbers)} {kind.value}"
        for kind, numbers in report.session.numbers.items()
        if numbers
    ]
    return ", ".join(counts) or "none"


def _minutes(minutes: Mapping[str, float]) -> str:
    steps = ", ".join(f"{kind} {one:.1f}" for kind, one in minutes.items())
    return f"{sum(minutes.values()):.1f} minutes by table 4 of the paper ({steps or 'nothing asked for'})"


def _section(title: str, inner: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{inner}</section>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    body = "".join(f"<tr>{''.join(f'<td>{escape(one)}</td>' for one in row)}</tr>" for row in rows)
    return f"<table>{f'<tr>{head}</tr>' if heads else ''}{body}</table>"


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return "-" if value is None else str(value)


def _when(unix_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S %Z", time.localtime(unix_s))
