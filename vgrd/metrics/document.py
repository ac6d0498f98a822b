"""Writes docs/metrics.md from the table of metrics: `python -m vgrd.metrics.document FILE`."""

import sys
from pathlib import Path

from vgrd.metrics.table import METRICS

_INTRODUCTION = """\
# Metrics

Generated from `vgrd/metrics/table.py` by `python -m vgrd.metrics.document docs/metrics.md`.

```toml
[metrics]
port = 9502            # off without it
host = "127.0.0.1"     # or the address at which the plant's Prometheus reaches this computer
```

`http://HOST:PORT/metrics` is read by Prometheus, text format 0.0.4. The process that answers is one of its own, at a
lower priority, and asks the daemon at most once a second what `vgrd status` asks. Robots never wait for it. It takes
eight clients at a time and twenty connections a second; whatever else than `GET /metrics` comes is dropped and
counted. There is no password: leave it at the loopback, or let the firewall say who may ask ([service.md](service.md)).

What is not known has no sample, an old value never stands for a new one. `vgrd_cell_up` is 0 while the cell process
does not answer. Counters begin at 0 with the process that counts.

```yaml
scrape_configs:
  - job_name: vgrd
    static_configs: [{ targets: ["192.168.1.5:9502"] }]
# Alerts worth having:
#   vgrd_fault_code == 503                            something moved: a person must look
#   increase(vgrd_process_starts_total[1h]) > 3       a device or a cable dies
#   vgrd_recording_paused == 1                        the disk is full
#   time() - vgrd_cell_file_loaded_timestamp_seconds  who restarted or reloaded it?
```

| metric | type | labels | meaning |
| --- | --- | --- | --- |
"""


def document() -> str:
    """The whole page."""
    rows = (
        f"| {metric.name} | {metric.kind} | {', '.join(metric.labels)} | {metric.help} |\n"
        for metric in METRICS
    )
    return _INTRODUCTION + "".join(rows)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
