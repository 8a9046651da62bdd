# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from diamond import AFFORDING_NETWORK, SMALL_NETWORK, diamond_network
from labelled import CENTER, SIDE, TOP, labels_of

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.model import GraspNetwork, save_network
from neugrasp_ros.training.cache import POINT_SCALE, load_entry
from neugrasp_ros.training.occupancy import SceneCache
from neugrasp_ros.training.run import (
    DEFAULT_STAGES,
    SEEN_FROM,
    TrainingRun,
    _finish,
    _new_network,
    render_scenes,
    train_stage,
)
from neugrasp_ros.training.views import EDGE
from sim_bridge.objects.affordances import AFFORDANCE_NAMES
from sim_bridge.objects.registry import object_set
from sim_bridge.scene import PlacedObject

HANDS = [translation(0, 0, 0.005 * i) @ hand for i in range(4) for hand in (TOP, SIDE)]


@pytest.fixture(params=["plain", "residual"])
def unet(request):
    return request.param


@pytest.fixture
def network(unet):
    return diamond_network(replace(SMALL_NETWORK, unet=unet), CENTER, 0.04)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    render_scenes([labels_of(TOP, index=7)], folder / "tune_scenes", workers=1)
    return folder


def test_the_papers_terms_come_one_after_the_other_and_the_context_last():
    assert [stage.stage for stage in DEFAULT_STAGES] == [
        "occupancy",
        "quality",
        "joint",
        "hands",
        "context",
    ]


@pytest.mark.slow
def test_a_scene_is_rendered_once(rendered):
    path = rendered / "tune_scenes" / "0000007.npz"
    entry, stamp = load_entry(path), path.stat().st_mtime_ns
    assert entry.volumes.shape[1:] == (64, 64, 64)
    assert entry.occupied.any()
    render_scenes([labels_of(TOP, index=7)], rendered / "tune_scenes", workers=1)
    assert path.stat().st_mtime_ns == stamp


def test_a_scene_without_objects_is_not_rendered(tmp_path):
    empty = labels_of(TOP)
    empty = replace(empty, scene=replace(empty.scene, objects=()))
    render_scenes([empty], tmp_path / "scenes", workers=1)
    assert list((tmp_path / "scenes").iterdir()) == []


def labelled_mug() -> Any:
    """A mug that the hands hold by its body, as far as they hold."""
    labels = labels_of(*HANDS)
    name = next(n for n in object_set("affordance").names if n.startswith("mug/"))
    placed = PlacedObject("affordance", name, 1.0, translation(*CENTER))
    affordances = np.zeros((len(HANDS), len(AFFORDANCE_NAMES)), dtype=np.uint8)
    affordances[:, AFFORDANCE_NAMES.index("pour")] = 1
    return replace(
        labels,
        scene=replace(labels.scene, objects=(placed,)),
        grasps=replace(labels.grasps, affordances=affordances),
    )


@pytest.fixture
def context_network(unet):
    config = replace(
        AFFORDING_NETWORK, affordances=AFFORDANCE_NAMES, context=4, hand_view=4
    )
    config = replace(config, thing_head=True)
    return diamond_network(replace(config, resolution=64, unet=unet), CENTER, 0.04)


def test_points_on_labelled_objects_are_rendered_with_a_scene(tmp_path):
    render_scenes([labelled_mug()], tmp_path, workers=1)
    (entry,) = map(load_entry, tmp_path.glob("*.npz"))
    assert len(entry.part_points) > 500
    pour, cut = (AFFORDANCE_NAMES.index(name) for name in ("pour", "cut"))
    assert 0.3 < entry.part_classes[:, pour].mean() < 1.0  # a rim is for handing over
    assert not entry.part_classes[:, cut].any()


def test_points_know_what_their_own_thing_affords(tmp_path):
    mug = labelled_mug()
    (held,) = mug.scene.objects
    knife = replace(
        held, name="knife/chef/000000", T_task_object=translation(0.15, 0.25, CENTER[2])
    )
    plain = replace(
        knife, set_name="procedural", name=object_set("procedural").names[0]
    )
    scene = replace(mug.scene, objects=(held, plain, knife))
    render_scenes([replace(mug, scene=scene)], tmp_path, workers=1)
    (entry,) = map(load_entry, tmp_path.glob("*.npz"))
    on_knife = entry.part_points[:, 1] / POINT_SCALE * EDGE > 0.2
    of = {name: AFFORDANCE_NAMES.index(name) for name in AFFORDANCE_NAMES}
    for names, rows in ((("cut", "stab"), on_knife), (("wrap", "pour"), ~on_knife)):
        assert rows.sum() > 200
        columns = [of[name] for name in names]
        assert entry.part_things[rows][:, columns].all()
        assert not entry.part_things[~rows][:, columns].any()
        assert not entry.part_classes[rows][:, columns].all()
    assert entry.part_things[:, of["handover"]].all()


@pytest.mark.parametrize(
    ("stage", "trained"),
    [
        ("quality", ("detector.read.", "detector.quality.")),
        ("joint", ("scene.", "detector.read.", "detector.quality.")),
        ("hands", ("hands.",)),
        ("context", ("context.", "hands.", "detector.affordance.")),
    ],
)
def test_a_stage_leaves_the_rest_of_a_network_with_context(
    context_network, stage, trained, tmp_path
):
    network, scenes = context_network, [labelled_mug()]
    before = {k: v.clone() for k, v in network.state_dict().items()}
    config = TrainConfig(stage=stage, steps=2, scenes_per_step=2, grasps_per_scene=4)
    render_scenes(scenes, tmp_path / "scenes", workers=1)
    train_stage(network, config, tmp_path, scenes)
    changed = {k for k, v in network.state_dict().items() if (v != before[k]).any()}
    assert changed
    assert all(key.startswith(trained) for key in changed)
    assert all(p.requires_grad for p in network.parameters())


@pytest.mark.parametrize(
    ("stage", "taught", "looked_at"),
    [
        ("occupancy", {0}, set()),
        ("joint", {0}, {0}),
        ("hands", {0, SEEN_FROM}, set()),
        ("context", {0, SEEN_FROM}, {0}),
    ],
)
def test_seen_scenes_teach_the_context_and_the_hands_alone(
    context_network, stage, taught, looked_at, tmp_path, monkeypatch
):
    drawn = set()
    monkeypatch.setattr(
        SceneCache, "__getitem__",
        lambda cache, name: drawn.add(int(name)) or cache._entries[name],
    )  # fmt: skip
    scenes = [labelled_mug(), replace(labelled_mug(), index=SEEN_FROM)]
    config = TrainConfig(stage=stage, steps=1, scenes_per_step=4, grasps_per_scene=4)
    render_scenes(scenes, tmp_path / "scenes", workers=1)
    train_stage(context_network, config, tmp_path, scenes[:1], seen=scenes[1:])
    assert drawn == taught
    rendered = {int(p.stem.split("_")[0]) for p in tmp_path.glob("grasps/*.npz")}
    assert rendered == looked_at


def test_the_quality_stage_trains_the_detector_alone(network, tmp_path):
    before = {k: v.clone() for k, v in network.state_dict().items()}
    config = TrainConfig(
        stage="quality", steps=2, scenes_per_step=2, grasps_per_scene=4
    )
    train_stage(network, config, tmp_path, [labels_of(*HANDS)])
    changed = {
        key for key, value in network.state_dict().items()
        if not torch.equal(value, before[key])
    }  # fmt: skip
    assert changed
    assert all(key.startswith("detector.") for key in changed)
    assert (tmp_path / "quality" / "state.pt").is_file()
    assert np.isfinite([p.detach().abs().max() for p in network.parameters()]).all()


def test_a_new_encoder_needs_a_stage_that_teaches_it(tmp_path):
    start = tmp_path / "start.safetensors"
    save_network(GraspNetwork(AFFORDING_NETWORK), start)
    run = TrainingRun(
        train=(), tune=tmp_path, folder=tmp_path, weights=tmp_path / "out",
        network=replace(AFFORDING_NETWORK, unet="residual"), start=start,
        stages=(TrainConfig(stage="quality"),),
    )  # fmt: skip
    known = replace(labelled_mug(), index=1)
    with pytest.raises(ConfigError, match="another scene encoder: .* occupancy or"):
        _new_network(run, [known])
    taught = replace(run, stages=(TrainConfig(stage="joint"), *run.stages))
    assert _new_network(taught, [known]).config.unet == "residual"


def test_a_context_stage_without_a_context_is_refused(tmp_path):
    run = TrainingRun(
        train=(), tune=tmp_path, folder=tmp_path, weights=tmp_path / "w",
        network=SMALL_NETWORK, stages=(TrainConfig(stage="context", steps=1),),
    )  # fmt: skip
    with pytest.raises(ConfigError, match="without context nothing"):
        _new_network(run, [])


@pytest.mark.parametrize(
    ("stages", "started", "fitted"),
    [(("context",), True, False), (("context",), False, True),
     (("joint", "context"), True, True)],
)  # fmt: skip
def test_the_context_alone_leaves_the_calibration_of_the_quality(
    monkeypatch, tmp_path, stages, started, fitted
):
    asked = []
    monkeypatch.setattr(
        "neugrasp_ros.training.run.calibrate",
        lambda *args, quality: asked.append(quality) or {},
    )
    start = tmp_path / "start"
    start.write_bytes(b"a file to be named")
    run = TrainingRun(
        train=(), tune=tmp_path, folder=tmp_path, weights=tmp_path / "w",
        network=SMALL_NETWORK, start=start if started else None,
        stages=tuple(TrainConfig(stage=name, steps=1) for name in stages),
    )  # fmt: skip
    card = _finish(run, GraspNetwork(SMALL_NETWORK), [], [], [])
    assert asked == [fitted]
    assert ("start" in card) == started
