"""What a person has to confirm stays latched, whoever dies in between and whatever the disk does."""

import asyncio
from pathlib import Path

import pytest

from vgrd.cell.serving.latches import LATCH_FILE, LATCH_RING, LatchBook
from vgrd.errors import StoreError
from vgrd.registers import Status

FAULT = (Status.TCP_OFFSET_CHANGED, "the active TCP is 5 mm off")
LONG_S = 10.0


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    run, state = tmp_path / "run", tmp_path / "state"
    run.mkdir()
    return run, state


def kept(book: LatchBook) -> None:
    """Let what was noted come to the disk."""

    async def fit_joint() -> None:
        task = asyncio.create_task(book.run())
        try:
            async with asyncio.timeout(LONG_S):
                await book.settled()
        finally:
            task.cancel()

    asyncio.run(fit_joint())


def test_nothing_is_latched_at_first(folders: tuple[Path, Path]) -> None:
    assert LatchBook(*folders).latched is None
    assert LatchBook(*folders).latched is None


def test_a_latch_outlives_a_process_killed_right_after_the_fault(
    folders: tuple[Path, Path],
) -> None:
    LatchBook(*folders).note(FAULT)  # and nothing of this process runs any more
    assert LatchBook(*folders).latched == FAULT
    assert LatchBook(*folders).latched == FAULT


def test_a_latch_outlives_the_runtime_folder(folders: tuple[Path, Path]) -> None:
    book = LatchBook(*folders)
    book.note(FAULT)
    kept(book)
    (folders[0] / LATCH_RING).unlink()
    assert LatchBook(*folders).latched == FAULT


def test_a_confirmed_latch_is_gone_for_good(folders: tuple[Path, Path]) -> None:
    book = LatchBook(*folders)
    book.note(FAULT)
    book.note(None)
    kept(book)
    assert LatchBook(*folders).latched is None
    assert not (folders[1] / LATCH_FILE).exists()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        (LATCH_FILE, b""),
        (LATCH_FILE, b'{"status": 404}'),
        (LATCH_RING, b"garbage" * 1000),
        (LATCH_RING, b""),
    ],
)
def test_what_cannot_be_read_is_latched_until_it_is_confirmed(
    folders: tuple[Path, Path], name: str, content: bytes
) -> None:
    book = LatchBook(*folders)
    book.note(FAULT)
    kept(book)
    run, state = folders
    LatchBook(*folders).note(None)
    (state / LATCH_FILE).unlink()
    (state if name == LATCH_FILE else run).joinpath(name).write_bytes(content)
    again = LatchBook(*folders)
    assert again.latched is not None
    assert "unreadable" in again.latched[1]
    assert "vgrd confirm" in again.latched[1]
    again.note(None)
    kept(again)
    assert LatchBook(*folders).latched is None


def test_a_disk_that_takes_nothing_is_told_and_the_latch_holds(
    folders: tuple[Path, Path],
) -> None:
    run, state = folders
    state.write_bytes(b"a file in place of the folder")
    book = LatchBook(run, state)
    book.note(FAULT)
    with pytest.raises(StoreError, match="until the next start"):
        kept(book)
    assert LatchBook(run, state).latched is not None


def test_a_reason_of_any_length_fits(folders: tuple[Path, Path]) -> None:
    LatchBook(*folders).note((Status.TCP_OFFSET_CHANGED, "\N{SNOWMAN}" * 10_000))
    latched = LatchBook(*folders).latched
    assert latched is not None
    assert latched[1].startswith("\N{SNOWMAN}")
