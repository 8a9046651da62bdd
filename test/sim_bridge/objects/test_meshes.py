# SPDX-License-Identifier: Apache-2.0
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh, box_mesh
from sim_bridge.objects import meshes
from sim_bridge.objects.mesh_repair import merge_meshes
from sim_bridge.objects.meshes import (
    MeshFolderOptions,
    egad_scale,
    find_meshes,
    load_bare_mesh,
    read_options,
)


def write_obj(path, *parts):
    whole = merge_meshes(parts)
    lines = ["v {} {} {}".format(*vertex) for vertex in whole.vertices]
    lines += ["f {} {} {}".format(*(triangle + 1)) for triangle in whole.triangles]
    path.write_text("\n".join(lines))
    return path


def cuboid(x, y, z, at=(0.0, 0.0, 0.0)):
    box = box_mesh(np.array([x, y, z]) / 2)
    return Mesh(box.vertices + at, box.triangles)


def test_metric_mesh_is_centred_and_weighed(tmp_path):
    path = write_obj(tmp_path / "a.obj", cuboid(0.1, 0.05, 0.04, at=(1.0, 0, 0)))
    model = load_bare_mesh(path, "set", MeshFolderOptions())
    np.testing.assert_allclose(
        model.bounds(), [[-0.05, -0.025, -0.02], [0.05, 0.025, 0.02]]
    )
    np.testing.assert_allclose(model.center_of_mass, 0.0, atol=1e-12)
    assert model.mass == pytest.approx(400.0 * 0.1 * 0.05 * 0.04)
    assert (model.file_unit, model.note, len(model.parts)) == (1.0, "", 1)


def test_mesh_of_100_units_is_taken_as_millimetres(tmp_path):
    path = write_obj(tmp_path / "a.obj", cuboid(100.0, 50.0, 40.0, at=(46.0, 46, 46)))
    model = load_bare_mesh(path, "set", MeshFolderOptions())
    np.testing.assert_allclose(model.extents(), [0.1, 0.05, 0.04])
    assert model.file_unit == 0.001


def test_options_fix_unit_mass_and_friction(tmp_path):
    path = write_obj(tmp_path / "a.obj", cuboid(1.0, 1.0, 1.0))
    options = MeshFolderOptions(unit=0.05, mass=0.2, friction=0.5)
    model = load_bare_mesh(path, "set", options)
    np.testing.assert_allclose(model.extents(), 0.05)
    assert (model.mass, model.friction) == (0.2, 0.5)


def test_concave_mesh_without_decomposition_is_its_hull_and_says_so(tmp_path, caplog):
    long, leg = cuboid(0.1, 0.02, 0.02), cuboid(0.02, 0.02, 0.08, at=(0.2, 0, 0.03))
    path = write_obj(tmp_path / "l.obj", long, leg)
    model = load_bare_mesh(path, "set", MeshFolderOptions(decompose=False))
    assert len(model.parts) == 1
    assert "convex hull" in model.note
    assert "decompose is off" in model.note
    assert model.note in caplog.text
    assert model.visuals[0].volume() == pytest.approx(0.1 * 4e-4 + 0.08 * 4e-4)


def test_decomposition_is_used_and_kept(tmp_path, monkeypatch):
    calls = []
    pieces = [cuboid(0.1, 0.02, 0.02), cuboid(0.02, 0.02, 0.08, at=(0.2, 0, 0.03))]

    def run_coacd(mesh, **options):
        calls.append(options["max_convex_hull"])
        return [(piece.vertices, piece.triangles) for piece in pieces]

    engine = SimpleNamespace(
        run_coacd=run_coacd, Mesh=lambda v, t: (v, t), set_log_level=lambda level: None
    )
    monkeypatch.setitem(sys.modules, "coacd", engine)
    monkeypatch.setattr(meshes.importlib.util, "find_spec", lambda name: engine)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = write_obj(tmp_path / "l.obj", *pieces)
    first = load_bare_mesh(path, "set", MeshFolderOptions())
    second = load_bare_mesh(path, "set", MeshFolderOptions())
    assert [len(first.parts), len(second.parts), len(calls)] == [2, 2, 1]
    np.testing.assert_array_equal(first.parts[1].vertices, second.parts[1].vertices)
    assert first.note == ""


def test_sheet_encloses_no_volume(tmp_path):
    path = tmp_path / "sheet.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(ObjectFileError, match=r"sheet\.obj: encloses no volume"):
        load_bare_mesh(path, "set", MeshFolderOptions())


def test_mesh_beyond_repair_is_replaced_by_its_parts(tmp_path):
    cube = cuboid(0.1, 0.1, 0.1)
    fin = np.concatenate([cube.triangles, [[0, 7, 3]]])
    path = write_obj(tmp_path / "fin.obj", Mesh(cube.vertices, fin))
    model = load_bare_mesh(path, "set", MeshFolderOptions())
    assert "stand in" in model.note
    assert model.visuals[0].volume() == pytest.approx(1e-3)


def test_sidecar_file_is_read_and_checked(tmp_path):
    assert read_options(tmp_path) == MeshFolderOptions()
    (tmp_path / "objects.yaml").write_text("unit: 0.01\nmass: 0.3\n")
    assert read_options(tmp_path) == MeshFolderOptions(unit=0.01, mass=0.3)
    (tmp_path / "objects.yaml").write_text("weight: 1\n")
    with pytest.raises(ConfigError, match="expected a mapping of unit, mass"):
        read_options(tmp_path)


def test_meshes_are_found_by_ending_and_sorted(tmp_path):
    for name in ("b.OBJ", "a.stl", "c.mtl", "objects.yaml"):
        (tmp_path / name).touch()
    assert list(find_meshes(tmp_path)) == ["a", "b"]


@pytest.mark.parametrize(("draw", "expected"), [(0.8, 6.0), (1.0, 7.5), (1.4, 10.5)])
def test_egad_cubes_land_at_the_published_sizes(tmp_path, draw, expected):
    path = write_obj(tmp_path / "cube.obj", cuboid(100.0, 100.0, 100.0))
    model = load_bare_mesh(path, "set", MeshFolderOptions())
    edge = 100 * model.scaled(egad_scale(model, draw)).extents()[0]
    assert edge == pytest.approx(expected, abs=0.55)


def test_egad_scale_needs_34_shrinkings_and_ignores_the_unit(tmp_path):
    path = write_obj(tmp_path / "cube.obj", cuboid(100.0, 100.0, 100.0))
    guessed = load_bare_mesh(path, "set", MeshFolderOptions())
    raw = load_bare_mesh(path, "set", MeshFolderOptions(unit=1.0))
    a, b = egad_scale(guessed, 1.0), egad_scale(raw, 1.0)
    assert a * guessed.file_unit == pytest.approx(b)
    n_fifths = np.log(b) / np.log(0.8)
    assert 30 <= n_fifths <= 34


def test_egad_scale_ends_for_a_sheet_that_can_never_fit(tmp_path):
    path = write_obj(tmp_path / "sheet.obj", cuboid(100.0, 100.0, 0.5))
    model = load_bare_mesh(path, "set", MeshFolderOptions())
    extents = model.scaled(egad_scale(model, 1.0)).extents()
    assert extents[2] < 0.014
    assert extents[0] < 0.2
