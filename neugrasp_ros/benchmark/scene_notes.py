# SPDX-License-Identifier: Apache-2.0
"""Figures of single scenes, written down as they come: a stopped run goes on there."""

import json
from pathlib import Path
from typing import Any


class SceneNotes:
    """A file of one JSON value a line: first what it is about, then a scene each.

    Args:
        path: The file; None = nothing is written.
        about: What the figures depend on; a file about something else is begun anew.

    Attributes:
        known: Figures by the number of the scene.
    """

    def __init__(self, path: Path | None, about: dict[str, Any]) -> None:
        self._path = path
        self._about = json.loads(json.dumps(about))
        self.known: dict[int, Any] = {}
        if path is not None and path.exists():
            self.known = self._read(path)
        if path is not None and not self.known:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self._about) + "\n")

    def _read(self, path: Path) -> dict[int, Any]:
        """Return a file's scenes; a last line that was cut off is dropped for good."""
        lines = path.read_text().splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]
        if not whole or json.loads(whole[0]) != self._about:
            return {}
        if len(whole) < len(lines):
            path.write_text("".join(whole))
        notes = [json.loads(line) for line in whole[1:]]
        return {note["scene"]: note["figures"] for note in notes}

    def keep(self, scene: int, figures: Any) -> None:
        """Write down a scene's figures, anything that JSON takes."""
        self.known[scene] = figures
        if self._path is not None:
            with self._path.open("a") as file:
                file.write(json.dumps({"scene": scene, "figures": figures}) + "\n")
