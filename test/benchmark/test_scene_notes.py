# SPDX-License-Identifier: Apache-2.0
import json

from neugrasp_ros.benchmark.scene_notes import SceneNotes

ABOUT = {"seed": 3, "size": (1, 2)}


def test_a_stopped_run_finds_its_scenes_again(tmp_path):
    path = tmp_path / "new" / "notes.jsonl"
    notes = SceneNotes(path, ABOUT)
    notes.keep(0, {"gaps": [0.1, 0.2]})
    notes.keep(4, {"gaps": []})
    again = SceneNotes(path, ABOUT)
    assert again.known == notes.known == {0: {"gaps": [0.1, 0.2]}, 4: {"gaps": []}}


def test_a_line_that_was_cut_off_is_made_again(tmp_path):
    path = tmp_path / "notes.jsonl"
    notes = SceneNotes(path, ABOUT)
    notes.keep(0, 1.0)
    notes.keep(1, 2.0)
    path.write_text(path.read_text()[:-5])
    again = SceneNotes(path, ABOUT)
    assert again.known == {0: 1.0}
    again.keep(1, 3.0)
    assert SceneNotes(path, ABOUT).known == {0: 1.0, 1: 3.0}


def test_a_file_about_something_else_is_begun_anew(tmp_path):
    path = tmp_path / "notes.jsonl"
    SceneNotes(path, ABOUT).keep(0, 1.0)
    other = {**ABOUT, "seed": 4}
    assert SceneNotes(path, other).known == {}
    assert [json.loads(line) for line in path.read_text().splitlines()] == [
        {"seed": 4, "size": [1, 2]}
    ]


def test_a_file_that_was_cut_off_in_its_first_line_is_begun_anew(tmp_path):
    path = tmp_path / "notes.jsonl"
    path.write_text('{"seed": 3')
    SceneNotes(path, ABOUT).keep(2, 1.0)
    assert SceneNotes(path, ABOUT).known == {2: 1.0}


def test_without_a_file_scenes_are_kept_in_memory(tmp_path):
    notes = SceneNotes(None, ABOUT)
    notes.keep(0, 1.0)
    assert notes.known == {0: 1.0}
    assert not list(tmp_path.iterdir())
