# SPDX-License-Identifier: Apache-2.0
import json
import pickle

import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import box_mesh
from sim_bridge.objects.affordance_net import HUMAN_CLASSES
from sim_bridge.objects.affordances import AFFORDANCE_NAMES
from sim_bridge.objects.registry import object_set

MUG = [
    {"name": "container", "objs": ["body"]},
    {"name": "handle", "objs": ["handle"]},
]


def write_box(folder, name, half, at):
    mesh = box_mesh(np.array(half))
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices + at]
    lines += ["f {} {} {}".format(*(triangle + 1)) for triangle in mesh.triangles]
    (folder / "objs" / f"{name}.obj").write_text("\n".join(lines))


@pytest.fixture
def shapes(tmp_path):
    """Return a root with one mug, its handle towards +x and y up, and its labels."""
    folder = tmp_path / "5678"
    (folder / "objs").mkdir(parents=True)
    (folder / "result_after_merging.json").write_text(json.dumps(MUG))
    (folder / "meta.json").write_text(
        json.dumps({"model_cat": "Mug", "model_id": "m1"})
    )
    write_box(folder, "body", (0.4, 0.5, 0.4), (-0.1, 0, 0))
    write_box(folder, "handle", (0.1, 0.2, 0.05), (0.4, 0, 0))
    points = np.array([[-1.0, -1, -0.8], [1, 1, 0.8], [0.9, 0, 0]])
    labels = {name: np.zeros((3, 1)) for name in HUMAN_CLASSES}
    labels["grasp"] = np.array([[0.0], [0.0], [0.7]])
    full = {"coordinate": points, "label": labels}
    entry = {"shape_id": "m1", "semantic class": "Mug", "full_shape": full}
    (tmp_path / "full_shape.pkl").write_bytes(pickle.dumps([entry]))
    return tmp_path


def test_folder_of_partnet_shapes_is_an_object_set(shapes):
    model = object_set(str(shapes)).load("5678")
    assert (model.category, model.set_name) == ("mug", shapes.name)
    assert model.part_labels() == ("body", "handle")
    assert model.extents().max() == pytest.approx(0.11)


def test_affordance_net_points_are_laid_over_the_model(shapes):
    model = object_set(str(shapes)).load("5678")
    points, classes = model.point_labels
    diagonal = np.linalg.norm(points[1] - points[0])
    assert diagonal == pytest.approx(np.linalg.norm(model.extents()))
    np.testing.assert_allclose(points[0] + points[1], 0.0, atol=1e-12)
    assert points[0, 1] > 0  # the file's -z is our +y
    pour = classes[:, AFFORDANCE_NAMES.index("pour")]
    assert pour.tolist() == [False, False, True]


def test_shape_without_labels_has_those_of_its_parts(shapes):
    (shapes / "full_shape.pkl").unlink()
    assert object_set(str(shapes)).load("5678").point_labels is None


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ("{", "expected model_cat"),
        ('{"model_id": "a"}', "model_cat"),
        ('{"model_cat": "Chair", "model_id": "a"}', "'chair'; known: knife"),
    ],
)
def test_broken_meta_files_are_refused(shapes, meta, message):
    (shapes / "5678" / "meta.json").write_text(meta)
    with pytest.raises(ObjectFileError, match=message):
        object_set(str(shapes)).load("5678")
