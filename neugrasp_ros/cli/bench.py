# SPDX-License-Identifier: Apache-2.0
"""``neugrasp bench``: clutter-removal rounds in physics."""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

from neugrasp_ros.cli.counts import require_positive


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser("bench", help="clutter-removal rounds in physics")
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
        "the scene where four cubes meet; the floors random and geometry; or "
        "oracle_sampling, oracle_local, oracle_surface, which are told the true "
        "surface",
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
    from neugrasp_ros.benchmark.report import figures, say, write_report
    from neugrasp_ros.benchmark.runner import run_suite
    from neugrasp_ros.benchmark.table import load_results, markdown_table
    from neugrasp_ros.config import PlannerConfig
    from neugrasp_ros.errors import ConfigError

    if args.table:
        print(markdown_table(load_results(args.table)))
        return 0
    require_positive(args, "rounds")
    if args.candidates < N_CANDIDATES:
        raise ConfigError(
            f"--candidates must be at least {N_CANDIDATES}, which tell whether a true "
            f"grasp is there, got {args.candidates}"
        )
    served = args.scene == "affordance"
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
    rounds = []
    for record in run_suite(suite, range(args.rounds), setup, args.workers):
        rounds.append(record)
        print(say(rounds, args.rounds), flush=True)
    command = "neugrasp " + " ".join(sys.argv[1:])
    result = figures(suite, args.policy, rounds, args.weights, command)
    if served:
        count = args.rounds if args.probes is None else args.probes
        result["affordance"] = _probe(suite, count, config, args)
    if args.json:
        write_report(args.json, result)
    print({k: v for k, v in result.items() if k not in ("rounds", "attempt_list")})
    return 0


def _probe(
    suite: Any, count: int, config: Any, args: argparse.Namespace
) -> dict[str, Any]:
    """Ask scenes about each class; return the figures."""
    import numpy as np

    from neugrasp_ros.benchmark.probe_figures import summarize_probes
    from neugrasp_ros.benchmark.runner import run_probes
    from neugrasp_ros.pipeline import GraspPlanner

    classes = GraspPlanner(config).affordances
    probes = []
    for probe in run_probes(
        suite,
        range(count),
        partial(_setup, "scored", config),
        args.workers,
        n_candidates=args.candidates,
    ):
        probes.append(probe)
        print(f"probe {len(probes)}/{count}: {probe.n_tried} grasps tried", flush=True)
    return summarize_probes(probes, classes, np.random.default_rng(0))
