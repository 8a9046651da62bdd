# SPDX-License-Identifier: Apache-2.0
import numpy as np

from sim_bridge.objects.affordance import load_affordance
from sim_bridge.objects.contact_sheet import contact_sheet, render_object
from sim_bridge.objects.procedural import load_procedural


def test_object_is_drawn_in_the_middle_on_white():
    image = render_object(load_procedural("can_000"), size=48)
    assert image.shape == (48, 48, 3)
    assert image.dtype == np.uint8
    assert (image[0, 0] == 255).all()
    assert (image[24, 24] < 250).all()


def test_labels_have_colours_of_their_own():
    image = render_object(load_affordance("knife/cleaver/000000"), size=64)
    drawn = image[(image < 255).any(axis=2)].astype(int)
    red, blue = drawn[:, 0] - drawn[:, 2] > 20, drawn[:, 2] - drawn[:, 0] > 20
    assert red.mean() > 0.1
    assert blue.mean() > 0.1


def test_sheet_fills_rows_and_leaves_the_rest_white():
    models = [load_procedural(f"box_{k:03d}") for k in range(3)]
    sheet = contact_sheet(models, columns=2, size=32)
    assert sheet.shape == (64, 64, 3)
    assert (sheet[32:, 32:] == 255).all()
    assert (sheet[32:, :32] < 250).any()
