# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import box_mesh
from sim_bridge.objects.partnet import PartNetOptions, load_partnet, part_label

TREE = [
    {
        "name": "cutting_instrument",
        "children": [
            {"name": "blade_side", "objs": ["blade"]},
            {"name": "handle_side", "children": [{"name": "grip", "objs": ["a", "b"]}]},
        ],
    }
]


def write_box(folder, name, half, at, n_faces=12):
    mesh = box_mesh(np.array(half))
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices + at]
    lines += ["f {} {} {}".format(*(t + 1)) for t in mesh.triangles[:n_faces]]
    (folder / "objs" / f"{name}.obj").write_text("\n".join(lines))


@pytest.fixture
def knife(tmp_path):
    """A knife along x, 2 units long, its edge towards +y, which is up in PartNet."""
    folder = tmp_path / "1234"
    (folder / "objs").mkdir(parents=True)
    (folder / "result_after_merging.json").write_text(json.dumps(TREE))
    write_box(folder, "blade", (0.5, 0.1, 0.02), (0.5, 0.3, 0))
    write_box(folder, "a", (0.25, 0.1, 0.05), (-0.25, 0.3, 0))
    write_box(folder, "b", (0.25, 0.1, 0.05), (-0.75, 0.3, 0))
    return folder


def test_parts_get_labels_size_and_an_upward_z(knife):
    model = load_partnet(knife, PartNetOptions("knife", 0.2))
    assert model.part_labels() == ("blade", "handle", "handle")
    np.testing.assert_allclose(model.extents(), [0.2, 0.01, 0.02], atol=1e-9)
    np.testing.assert_allclose(model.bounds().sum(axis=0), 0.0, atol=1e-9)
    volume = (1.0 * 0.2 * 0.04 + 2 * 0.5 * 0.2 * 0.1) * 1e-3
    assert model.mass == pytest.approx(400 * volume)
    assert (model.name, model.category, model.note) == ("1234", "knife", "")


def test_open_part_is_replaced_by_its_hull_and_counted(knife):
    write_box(knife, "a", (0.25, 0.1, 0.05), (-0.25, 0.3, 0), n_faces=6)
    model = load_partnet(knife, PartNetOptions("knife", 0.2))
    assert model.note.startswith("1 open part")
    assert model.visuals[1].volume() == pytest.approx(1e-5)


def test_word_in_a_parents_name_counts(tmp_path):
    assert part_label(tmp_path, "grip/handle_side/knife", "knife") == "handle"
    assert part_label(tmp_path, "lid/bottle", "bottle") == "neck"
    assert part_label(tmp_path, "container/mug", "mug") == "body"
    with pytest.raises(
        ObjectFileError, match="'tail' has no label; a mug knows handle"
    ):
        part_label(tmp_path, "tail", "mug")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not valid JSON"),
        ("{}", "expected a list"),
        ("[]", "names no part mesh"),
    ],
)
def test_broken_trees_are_refused(knife, text, message):
    (knife / "result_after_merging.json").write_text(text)
    with pytest.raises(ObjectFileError, match=message):
        load_partnet(knife, PartNetOptions("knife", 0.2))


def test_missing_files_are_named(knife, tmp_path):
    (knife / "objs" / "b.obj").unlink()
    with pytest.raises(ObjectFileError, match=r"b\.obj: cannot be read"):
        load_partnet(knife, PartNetOptions("knife", 0.2))
    with pytest.raises(ObjectFileError, match="result_after_merging.json: cannot be"):
        load_partnet(tmp_path, PartNetOptions("knife", 0.2))
