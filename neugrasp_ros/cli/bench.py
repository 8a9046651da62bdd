# SPDX-License-Identifier: Apache-2.0
"""``neugrasp bench``: clutter-removal rounds in physics."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from neugrasp_ros.cli.counts import require_positive

NOTED = ("rounds", "probes")
ASKED = ("neugrasp", "random", "geometry")  # policies of rounds of affordance objects


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "bench",
        help="clutter-removal rounds in physics",
        description="Records are written down beside --json as they come: a run that "
        "was stopped goes on there with the same code, weights and settings, also if "
        "it is to have more or fewer rounds.",
    )
    add = parser.add_argument
    add(
        "--scene", default="pile", choices=("pile", "packed", "egad", "affordance"),
        help="affordance: piles of held-out affordance objects, asked about each class",
    )  # fmt: skip
    add("--view", default="random", choices=("fixed", "random", "hard"))
    add("--objects", metavar="DIR|NAME", help="default procedural, or affordance; "
        "NAME@0.8 has only its objects of at least 0.8 kg")  # fmt: skip
    add("--part", choices=("train", "tune", "val", "all", "held_out"),
        help="default val, or held_out")  # fmt: skip
    add("--gripper", default="panda", metavar="NAME|FILE")
    add("--protocol", default="vgn", choices=("vgn", "strict"))
    add(
        "--policy", default="neugrasp", metavar="NAME",
        help="neugrasp; reference, the same with the paper's renderers; seams, with "
        "the scene where four cubes meet; no_scene_render, with candidates on what was "
        "seen alone; the floors random and geometry; or "
        "oracle_sampling, oracle_local, oracle_surface, which are told the true "
        "surface, and oracle_candidates, which is told what holds",
    )  # fmt: skip
    add("--rounds", type=int, default=100)
    add("--probes", type=int, help="scenes asked about each class; default --rounds")
    add(
        "--candidates", type=int, default=24,
        help="random candidates tried in each of these, 24 or more: more make average "
        "precisions surer, the queries stay the same",
    )  # fmt: skip
    add("--seed", type=int, default=0)
    add("--workers", type=int, default=1)
    add("--weights", default="", help="weights file; default the shipped one")
    add("--json", type=Path, help="where the figures go")
    add("--album", type=Path, metavar="FOLDER", help="draw every failed attempt")
    add(
        "--table", type=Path, metavar="FOLDER",
        help="run nothing: print the paper's table with the figures in a folder",
    )  # fmt: skip
    parser.set_defaults(run=run)


def _setup(policy: str, config: Any, album: Path | None = None) -> tuple[Any, Any]:
    from neugrasp_ros.benchmark.album import Album
    from neugrasp_ros.benchmark.policies import make_policy
    from neugrasp_ros.pipeline import use_threads

    use_threads(1)
    return make_policy(policy, config), Album(album) if album else None


def run(args: argparse.Namespace) -> int:
    """Run the rounds, say how it goes, write the figures."""
    from neugrasp_ros.benchmark.probes import N_CANDIDATES
    from neugrasp_ros.benchmark.protocol import Suite
    from neugrasp_ros.benchmark.records import round_from_record
    from neugrasp_ros.benchmark.report import command_line, figures, say, write_report
    from neugrasp_ros.benchmark.runner import run_suite
    from neugrasp_ros.benchmark.table import load_results, markdown_table
    from neugrasp_ros.config import PlannerConfig
    from neugrasp_ros.errors import ConfigError

    if args.table:
        print(markdown_table(load_results(args.table)))
        return 0
    if args.probes is None:
        args.probes = args.rounds
    require_positive(args, "rounds", "probes")
    if args.candidates < N_CANDIDATES:
        raise ConfigError(
            f"--candidates must be at least {N_CANDIDATES}, which tell whether a true "
            f"grasp is there, got {args.candidates}"
        )
    served = args.scene == "affordance"
    if served and args.policy not in ASKED:
        raise ConfigError(
            f"--scene affordance asks the network as it is about each class: --policy "
            f"must be one of {', '.join(ASKED)}, got {args.policy!r}"
        )
    suite = Suite(
        scene="pile" if served else args.scene,
        view=args.view,
        objects=args.objects or ("affordance" if served else "procedural"),
        part=args.part or ("held_out" if served else "val"),
        gripper=args.gripper,
        protocol=args.protocol,
        seed=args.seed,
    )
    config = PlannerConfig(weights=args.weights, gripper=args.gripper, threads=1)
    setup = partial(_setup, args.policy, config, args.album)
    notes = _notes(args, "rounds", suite, args.policy)
    rounds = [round_from_record(kept) for kept in _kept(notes, args.rounds)]
    for record in run_suite(suite, _missing(notes, args.rounds), setup, args.workers):
        notes.keep(record.index, record.as_record())
        rounds.append(record)
        print(say(rounds, args.rounds), flush=True)
    result = figures(suite, args.policy, rounds, args.weights, command_line())
    if served:
        result["affordance"] = _probe(suite, config, args)
    if args.json:
        write_report(args.json, result)
        for what in NOTED:
            _notes_path(args.json, what).unlink(missing_ok=True)
    print({k: v for k, v in result.items() if k not in ("rounds", "attempt_list")})
    return 0


def _notes_path(report: Path, what: str) -> Path:
    return report.with_suffix(f".{what}.jsonl")


def _notes(args: argparse.Namespace, what: str, *about: Any) -> Any:
    """Return where records are written down on the way to ``--json``.

    Args:
        args: Of the command.
        what: One of ``NOTED``.
        about: What the records depend on, besides the weights and the code.
    """
    from neugrasp_ros.benchmark.report import source_commit
    from neugrasp_ros.benchmark.scene_notes import SceneNotes
    from neugrasp_ros.geometry.gripper import load_gripper
    from neugrasp_ros.model import default_weights, file_sha256

    weights = file_sha256(Path(args.weights) if args.weights else default_weights())
    settings = {
        "about": repr(about),
        "gripper": repr(load_gripper(args.gripper)),
        "weights": weights,
        "commit": source_commit(),
    }
    return SceneNotes(_notes_path(args.json, what) if args.json else None, settings)


def _kept(notes: Any, count: int) -> list[Any]:
    """Return the noted records of the first scenes, in order."""
    return [notes.known[number] for number in range(count) if number in notes.known]


def _missing(notes: Any, count: int) -> list[int]:
    """Return which of the first scenes have no record yet."""
    return [number for number in range(count) if number not in notes.known]


def _probe(suite: Any, config: Any, args: argparse.Namespace) -> dict[str, Any]:
    """Ask scenes about each class; return the figures."""
    import numpy as np

    from neugrasp_ros.benchmark.probe_figures import summarize_probes
    from neugrasp_ros.benchmark.probes import probe_from_record
    from neugrasp_ros.benchmark.runner import run_probes
    from neugrasp_ros.pipeline import GraspPlanner

    classes, count = GraspPlanner(config).affordances, args.probes
    notes = _notes(args, "probes", suite, args.candidates)
    probes = [probe_from_record(kept) for kept in _kept(notes, count)]
    for probe in run_probes(
        suite,
        _missing(notes, count),
        partial(_setup, "scored", config),
        args.workers,
        n_candidates=args.candidates,
    ):
        notes.keep(probe.index, probe.as_record())
        probes.append(probe)
        print(f"probe {len(probes)}/{count}: {probe.n_tried} grasps tried", flush=True)
    return summarize_probes(probes, classes, np.random.default_rng(0))
