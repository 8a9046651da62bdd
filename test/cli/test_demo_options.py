# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.cli.main import main


@pytest.mark.parametrize("words", [("--seed", "-1"), ("--objects", "4294967296")])
def test_numbers_that_no_message_holds_are_refused_at_once(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["demo", *words])
    assert ended.value.code == 64
    assert "expected 0 to 2^32 - 1" in capsys.readouterr().err


def test_a_scene_beside_an_affordance_is_refused(capsys):
    assert main(["demo", "--affordance", "pour", "--scene", "packed"]) == 1
    assert "leave out --scene packed" in capsys.readouterr().err
