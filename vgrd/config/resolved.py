"""The cell file as it was checked: every key with its value, in the runtime folder, for this run.

The processes of a run start from this, also when they start again after a crash, never from the
user's file: that may be half saved, or hold values that nobody has checked. The name of the file
holds the checksum of what is in it.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

from vgrd.errors import ConfigError
from vgrd.permissions import opener

if TYPE_CHECKING:  # pydantic takes longer to load than everything that is done here
    from vgrd.config.cell_file import CellConfig

_PREFIX = "cell-"
_DIGITS = 16  # of the checksum: 64 bits against a mistake, nobody forges what he may write
_OF_DRIVERS = "settings"  # tables that stay as they are, their keys are the driver's


@dataclass(frozen=True, slots=True)
class Resolved:
    """A checked cell file. source: the user's file; loaded_unix_s: when it was read."""

    config: "CellConfig"
    source: str
    loaded_unix_s: float

    def values(self) -> Mapping[str, Any]:
        """Value of every key, "serving.port" for example."""
        return dict(_values(_plain(self.config), ""))


def changed_keys(running: Resolved, wanted: Resolved) -> list[str]:
    """Keys of the cell file, such as "serving.max_age_s", whose values are not the same."""
    old, new = running.values(), wanted.values()
    return [
        key for key in {**old, **new} if key not in old or key not in new or old[key] != new[key]
    ]


def save_resolved(resolved: Resolved, runtime_dir: Path) -> Path:
    """Write it into the runtime folder, whole or not at all; returns the file."""
    config = _plain(resolved.config)
    path = runtime_dir / f"{_PREFIX}{_digest(config)}.json"
    content = {
        "source": resolved.source,
        "loaded_unix_s": resolved.loaded_unix_s,
        "config": config,
    }
    draft = path.with_suffix(f".{os.getpid()}")
    with open(draft, "w", encoding="utf-8", opener=opener) as file:
        json.dump(content, file, indent=1)
    draft.replace(path)
    return path


def load_resolved(path: Path) -> Resolved:
    """Read what `save_resolved` wrote; raises ConfigError when it is not exactly that.

    The sections are plain values with the attributes of `CellConfig`: they were checked before.
    """
    try:
        content = json.loads(path.read_bytes())
        config, source, loaded = (content[key] for key in ("config", "source", "loaded_unix_s"))
    except (OSError, ValueError, TypeError, KeyError) as err:
        raise ConfigError(str(path), [f"cannot be read: {err!r}; start with `vgrd run`"]) from err
    if path.name != f"{_PREFIX}{_digest(config)}.json":
        raise ConfigError(str(path), ["was changed after it was checked: start with `vgrd run`"])
    return Resolved(cast("CellConfig", _section(config)), source, loaded)


def forget_resolved(runtime_dir: Path, but: Path) -> None:
    """Remove what earlier runs and reloads left."""
    for path in runtime_dir.glob(f"{_PREFIX}*.json"):
        if path != but:
            path.unlink(missing_ok=True)


def _digest(config: object) -> str:
    text = json.dumps(config, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _plain(config: object) -> Any:  # noqa: ANN401  whatever JSON holds
    """JSON data of a config, of either kind."""
    if isinstance(config, SimpleNamespace):
        return {key: _plain(value) for key, value in vars(config).items()}
    if isinstance(config, list):
        return [_plain(item) for item in config]
    dump = getattr(config, "model_dump", None)
    return config if dump is None else dump()


def _section(data: object) -> object:
    if isinstance(data, dict):
        return SimpleNamespace(
            **{
                key: value if key == _OF_DRIVERS else _section(value)
                for key, value in data.items()
            }
        )
    return [_section(item) for item in data] if isinstance(data, list) else data


def _values(data: object, key: str) -> Iterator[tuple[str, object]]:
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from _values(value, f"{key}.{name}" if key else name)
    elif isinstance(data, list) and data and isinstance(data[0], Mapping):
        for item in data:
            yield from _values(item, f"{key}.{item.get('name', '')}")
    else:
        yield key, data
