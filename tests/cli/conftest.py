"""The command line called as `vgrd WORDS...`, in this process."""

import json
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from vgrd import cli


class Done(NamedTuple):
    """What a command left: exit code, standard output, standard error."""

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        """The output as JSON."""
        assert self.code == 0, self.err
        return json.loads(self.out)


Vgrd = Callable[..., Done]


@pytest.fixture
def vgrd(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Vgrd:
    def call(*words: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["vgrd", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return Done(int(ended.value.code or 0), out, err)

    return call
