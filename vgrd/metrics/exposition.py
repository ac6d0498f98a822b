"""The text that Prometheus reads, version 0.0.4: HELP, TYPE, and a line for each sample."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from vgrd.metrics.facts import Facts
from vgrd.metrics.table import METRICS, Metric

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
_ESCAPES: Final = str.maketrans({"\\": r"\\", "\n": r"\n", '"': r"\""})


def exposition(facts: Facts, metrics: Sequence[Metric] = METRICS) -> bytes:
    """All metrics of a moment."""
    lines = (line for metric in metrics for line in _family(metric, facts))
    return "".join(f"{line}\n" for line in lines).encode()


def _family(metric: Metric, facts: Facts) -> Iterator[str]:
    yield f"# HELP {metric.name} {metric.help}"
    yield f"# TYPE {metric.name} {metric.kind}"
    for values, number in metric.read(facts):
        yield f"{metric.name}{_labels(metric.labels, values)} {number!r}"


def _labels(names: Iterable[str], values: Iterable[str]) -> str:
    pairs = [
        f'{name}="{value.translate(_ESCAPES)}"' for name, value in zip(names, values, strict=True)
    ]
    return "{" + ",".join(pairs) + "}" if pairs else ""
