"""Whether each camera of a cell file sees a board, and each board is seen."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from calib.instruments.board_table import BoardTable
from calib.instruments.camera_table import CameraTable
from calib.instruments.protocol import TIP, WORLD


def check_boards(
    cameras: Mapping[str, CameraTable], boards: Mapping[str, BoardTable], reading: Collection[str]
) -> None:
    """Each camera sees something, and each board is seen; ValueError in one line where not so.

    reading : cameras that read markers
    """
    seen = set[str]()
    for name, camera in cameras.items():
        _check_named(name, camera, boards)
        own = camera.seen(boards)
        if not own and name not in reading:
            raise ValueError(_sees_nothing(name, camera.on))
        if camera.rides_before(boards) and any(board.on != WORLD for board in own.values()):
            raise ValueError(
                f"has camera {name}, that sees boards in the world and on other links; name some of "
                "one kind, boards = ['NAME', ..], or let those in the world ride on [robot] base"
            )
        seen |= own.keys()
    for name, board in boards.items():
        if name not in seen:
            other = {WORLD: "on the tip", TIP: "on the world"}.get(board.on, "elsewhere")
            raise ValueError(
                f"has board {name} on {_named(board.on)} and no camera {other} that sees it"
            )


def _check_named(name: str, camera: CameraTable, boards: Mapping[str, BoardTable]) -> None:
    for board in camera.boards or ():
        if board not in boards or boards[board].on == camera.on:
            fault = "rides with it" if board in boards else "is none of [boards]"
            raise ValueError(f"has camera {name}, whose board {board} {fault}; take it out")


def _sees_nothing(name: str, on: str) -> str:
    if on == WORLD:
        return (
            f"has camera {name} in the world and nothing on the tip; add [boards.NAME] with "
            "on = 'tip', or [markers_mm]"
        )
    return (
        f"has camera {name} on {_named(on)} and nothing in the world; add [boards.NAME] with "
        "on = 'world', or on another link"
    )


def _named(on: str) -> str:
    return f"the {on}" if on in (TIP, WORLD) else on
