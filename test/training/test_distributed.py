# SPDX-License-Identifier: Apache-2.0
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("two_processes.py")


@pytest.mark.slow
def test_two_processes_start_alike_draw_apart_and_end_alike(tmp_path):
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]),
        "OMP_NUM_THREADS": "1",
    }
    subprocess.run(
        [
            sys.executable, "-m", "torch.distributed.run", "--standalone",
            "--nproc-per-node", "2", str(SCRIPT), str(tmp_path),
        ],
        check=True, env=environment, timeout=120, capture_output=True,
    )  # fmt: skip
    one, other = (
        json.loads((tmp_path / f"rank_{rank}.json").read_text()) for rank in (0, 1)
    )
    assert one["weights"] == other["weights"]
    assert one["statistics"] == other["statistics"]
    assert one["steps"] == [0, 2, 4, 6]
    assert other["steps"] == [1, 3, 5, 7]
    assert one["weights"] != one["first"]
    assert one["first"] == other["first"]
    assert one["drawn"] != other["drawn"]
    assert (one["share"], other["share"]) == ("ace", "bd")
    assert one["scarce"] == other["scarce"] == "a"
    assert (tmp_path / "once.txt").read_text() == "0"
    assert sorted(p.name for p in tmp_path.glob("state*")) == ["state.pt"]
