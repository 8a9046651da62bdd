# SPDX-License-Identifier: Apache-2.0
"""The profile as a table and as a picture of stacked bars."""

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from neugrasp_ros.benchmark.speed import STAGES

SIZE = (7.0, 2.6)  # [inch]
DPI = 120
OF_THE_SUITE = ("service_composed", "service_separate", "memory_composed")


def profile_table(result: dict[str, Any]) -> str:
    """Return the milliseconds of each stage, if there are any, and all else."""
    lines = []
    if "stages_ms" in result:
        lines = [f"{'stage':<16} {'median':>8} {'p90':>8}  [ms]"]
        totals = {"total": {k: result[f"total_ms_{k}"] for k in ("median", "p90")}}
        for name, value in (result["stages_ms"] | totals).items():
            lines.append(f"{name:<16} {value['median']:8.1f} {value['p90']:8.1f}")
    rest = {
        name: value
        for name, value in result.items()
        if isinstance(value, float) and not name.startswith("total")
    }
    for part in OF_THE_SUITE:
        for name, value in result.get(part, {}).items():
            rest[f"{part}.{name}"] = float(value)
    lines += [f"{name} {value:.4g}" for name, value in sorted(rest.items())]
    return "\n".join(lines)


def draw_profile(result: dict[str, Any], path: Path) -> None:
    """Draw median and 90th percentile of the stages as stacked bars."""
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for row, which in enumerate(("p90", "median")):
        left = 0.0
        for number, name in enumerate(STAGES):
            width = result["stages_ms"][name][which]
            label = name.replace("_", " ") if row else None
            axes.barh(row, width, left=left, color=f"C{number}", label=label)
            left += width
    axes.set_yticks([0, 1], ["p90 of each", "median"])
    axes.set_xlabel("time of a decision [ms]")
    axes.legend(
        ncols=3, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.4)
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
