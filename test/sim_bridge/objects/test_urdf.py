# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from sim_bridge.objects.urdf import find_urdfs, load_urdf

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
MESH = '<geometry><mesh filename="{}" scale="0.1 0.1 0.1"/></geometry>'


def write_urdf(folder, body, name="thing"):
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="x"><link name="a">{body}</link></robot>')
    return path


def test_mesh_urdf_gives_hulls_visual_mass_friction_and_centre(tmp_path):
    (tmp_path / "visual.obj").write_text(TETRAHEDRON)
    two = TETRAHEDRON.replace("f 1 3 2", "o one\nf 1 3 2") + "o two\n"
    two += "v 2 0 0\nv 3 0 0\nv 2 1 0\nv 2 0 1\nf 5 7 6\nf 5 6 8\nf 6 7 8\nf 5 8 7\n"
    (tmp_path / "collision.obj").write_text(two)
    path = write_urdf(
        tmp_path,
        '<contact><lateral_friction value="0.7"/></contact>'
        '<inertial><origin xyz="0 0 0.02"/><mass value="0.25"/></inertial>'
        f"<visual>{MESH.format('visual.obj')}</visual>"
        f'<collision><origin xyz="0.5 0 0"/>{MESH.format("collision.obj")}</collision>',
    )
    model = load_urdf(path, "set")
    assert (model.name, model.set_name) == ("thing", "set")
    assert (model.mass, model.friction, model.note) == (0.25, 0.7, "")
    assert [part.kind for part in model.parts] == ["hull", "hull"]
    assert model.parts[0].pose[0, 3] == 0.5
    assert model.visuals[0].volume() == pytest.approx(1e-3 / 6)
    np.testing.assert_allclose(model.center_of_mass, [0, 0, 0.02])


def test_primitive_geometry_and_rotation_are_read(tmp_path):
    geometry = '<geometry><cylinder radius="0.01" length="0.2"/></geometry>'
    origin = '<origin rpy="0 1.5707963267948966 0" xyz="0 0 0.1"/>'
    body = (
        f"<visual>{origin}{geometry}</visual><collision>{origin}{geometry}</collision>"
    )
    model = load_urdf(write_urdf(tmp_path, body), "set")
    assert model.parts[0].size == (0.01, 0.2)
    np.testing.assert_allclose(model.bounds()[:, 0], [-0.1, 0.1], atol=1e-12)


def test_box_extents_are_halved_and_defaults_apply(tmp_path):
    body = '<collision><geometry><box size="0.2 0.4 0.6"/></geometry></collision>'
    model = load_urdf(write_urdf(tmp_path, body), "set")
    assert model.parts[0].size == (0.1, 0.2, 0.3)
    assert (model.mass, model.friction) == (0.1, 1.0)
    assert "collision parts stand in" in model.note


def test_open_visual_mesh_is_replaced_and_said(tmp_path):
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    body = f"<visual>{MESH.format('sheet.obj')}</visual>{box}"
    model = load_urdf(write_urdf(tmp_path, body), "set")
    assert "not closed" in model.note
    assert model.visuals[0].volume() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", "is not valid XML"),
        ("<robot/>", "expected one link, found 0"),
        ('<robot><link name="a"/></robot>', "has no collision geometry"),
        ("<robot><link><collision/></link></robot>", "needs exactly one geometry"),
        (
            "<robot><link><collision><geometry><cone/></geometry></collision></link>"
            "</robot>",
            "unknown geometry 'cone'",
        ),
        (
            '<robot><link><collision><geometry><box size="1 2"/></geometry></collision>'
            "</link></robot>",
            "expected 3 numbers, got '1 2'",
        ),
        (
            '<robot><link><inertial><mass value="-1"/></inertial><collision><geometry>'
            '<box size="1 2 3"/></geometry></collision></link></robot>',
            "mass -1.0 is not positive",
        ),
        (
            '<robot><link><collision><geometry><mesh filename="package://x/a.obj"/>'
            "</geometry></collision></link></robot>",
            "expected a mesh beside the URDF",
        ),
        (
            '<robot><link><collision><geometry><mesh filename="none.obj"/></geometry>'
            "</collision></link></robot>",
            "none.obj: cannot be read",
        ),
    ],
)
def test_broken_urdfs_say_what_is_wrong(tmp_path, text, message):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(ObjectFileError, match=message):
        load_urdf(path, "set")


def test_urdfs_are_found_in_the_folder_and_one_below_sorted_by_name(tmp_path):
    for name in ("b/zebra.urdf", "ant.urdf", "a/mouse.urdf", "a/deep/no.urdf"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert list(find_urdfs(tmp_path)) == ["ant", "mouse", "zebra"]
