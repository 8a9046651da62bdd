# SPDX-License-Identifier: Apache-2.0
"""The paper's table with our rows beside it.

The paper's figures are means over five seeds in its own simulator with its own objects
(NeuGraspNet, section VI); ours are whatever the JSON files of ``neugrasp bench`` say.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from neugrasp_ros.errors import ConfigError

CELLS = tuple(
    (scene, view)
    for scene in ("pile", "packed")
    for view in ("fixed", "random", "hard")
)
PAPER: Mapping[str, tuple[tuple[float, float], ...]] = {
    "NeuGraspNet (paper)": (
        (86.5, 83.5), (85.1, 84.4), (74.0, 70.7),
        (97.7, 93.2), (92.5, 91.7), (78.8, 82.8),
    ),
    "EdgeGraspNet (paper)": (
        (80.3, 83.2), (78.8, 80.9), (68.1, 69.3),
        (85.1, 85.4), (86.1, 86.5), (81.6, 85.1),
    ),
    "GIGA (paper)": (
        (82.9, 73.6), (78.7, 76.0), (69.1, 64.8),
        (96.1, 76.8), (88.0, 75.6), (73.9, 68.5),
    ),
    "VGN (paper)": (
        (77.4, 64.0), (78.5, 74.1), (68.5, 64.1),
        (83.4, 54.1), (78.1, 60.1), (70.3, 38.6),
    ),
}  # fmt: skip
ROW_KEYS = ("policy", "gripper", "protocol", "suite_objects")


def load_results(folder: str | Path) -> list[dict[str, Any]]:
    """Read the files of ``neugrasp bench --json`` in a folder and below it.

    Raises:
        ConfigError: If there is none, or one is not such a file.
    """
    results = []
    for path in sorted(Path(folder).rglob("*.json")):
        try:
            result = json.loads(path.read_text())
        except ValueError as error:
            raise ConfigError(f"{path}: not JSON ({error})") from error
        if isinstance(result, dict) and {"gsr", "dr", "scene", "view"} <= set(result):
            results.append(result)
    if not results:
        raise ConfigError(f"{folder}: holds no result of `neugrasp bench --json`")
    return results


def markdown_table(results: Iterable[Mapping[str, Any]]) -> str:
    """Return the table: GSR/DR in percent, ours with the number of attempts.

    Args:
        results: Figures of benchmark runs; of several runs of one cell the longest
            counts.
    """
    header = ["GSR/DR %", *(f"{scene} {view}" for scene, view in CELLS)]
    rows = [
        [name, *(f"{gsr:.1f}/{dr:.1f}" for gsr, dr in figures)]
        for name, figures in PAPER.items()
    ]
    ours: dict[tuple[str, ...], dict[tuple[str, str], Mapping[str, Any]]] = {}
    for result in results:
        row = ours.setdefault(tuple(str(result.get(key, "?")) for key in ROW_KEYS), {})
        cell = (str(result["scene"]), str(result["view"]))
        if cell not in row or row[cell]["rounds"] < result["rounds"]:
            row[cell] = result
    for key, row in sorted(ours.items()):
        cells = [_cell(row[cell]) if cell in row else "-" for cell in CELLS]
        rows.append([", ".join(key), *cells])
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _cell(result: Mapping[str, Any]) -> str:
    gsr, dr = (
        "-" if result[key] is None else f"{result[key]:.1f}" for key in ("gsr", "dr")
    )
    return f"{gsr}/{dr} (n={result['attempts']})"
