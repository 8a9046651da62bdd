# SPDX-License-Identifier: Apache-2.0
"""The interface as text: run this file to write api.txt anew after a wanted change."""

from pathlib import Path

MSG_DEFS = Path(__file__).resolve().parents[2] / "msg_defs"
API = Path(__file__).resolve().parent / "api.txt"
KINDS = ("msg", "srv", "action")


def definitions() -> list[Path]:
    """Return every definition of neugrasp_msgs."""
    return [p for kind in KINDS for p in sorted((MSG_DEFS / kind).glob(f"*.{kind}"))]


def api() -> str:
    """Return all definitions without comments and spacing, in a fixed order."""
    blocks = []
    for path in definitions():
        lines = (line.split("#")[0].split() for line in path.read_text().splitlines())
        fields = [" ".join(words) for words in lines if words]
        blocks.append("\n".join([f"== {path.parent.name}/{path.stem}", *fields]))
    return "\n\n".join(blocks) + "\n"


if __name__ == "__main__":
    API.write_text(api())
