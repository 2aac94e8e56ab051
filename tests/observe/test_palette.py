import numpy as np

from swarmer.observe.palette import CALM, DARK, PALE, VIVID, Palette, swarm_colours

BACKGROUND = np.array([13, 16, 23])
LIT = np.ones(600, np.bool_)


def luminance(colour):
    """Of WCAG 2.1."""
    part = np.asarray(colour) / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def contrast(one, two):
    high, low = sorted((float(luminance(one)), float(luminance(two))), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_hundreds_of_swarms_are_all_seen_on_the_background():
    colours = swarm_colours(np.arange(1, 761))
    assert min(contrast(colour, BACKGROUND) for colour in colours) > 4.5
    assert len(np.unique(colours, axis=0)) > 500


def test_swarms_whose_ids_are_near_look_different():
    colours = swarm_colours(np.arange(1, 1001)).astype(int)
    for apart in range(1, 8):
        nearest = np.abs(colours[apart:] - colours[:-apart]).max(axis=1).min()
        assert nearest > 25, apart


def test_one_swarm_is_calm_and_two_are_not():
    palette = Palette(600)
    one = np.full(600, 7, np.int32)
    assert (palette.colours(one, LIT) == CALM).all()
    two = one.copy()
    two[:300] = 8
    assert {tuple(colour) for colour in palette.colours(two, LIT).tolist()} == {
        tuple(colour) for colour in swarm_colours(np.array([7, 8]), VIVID).tolist()
    }


def test_an_fls_by_itself_is_pale_until_it_has_company():
    swarm = np.arange(1, 601, dtype=np.int32)
    swarm[10:20] = 11
    colours = Palette(600).colours(swarm, LIT)
    assert colours[0].tolist() == swarm_colours(np.array([1]), PALE)[0].tolist()
    assert colours[15].tolist() == swarm_colours(np.array([11]), VIVID)[0].tolist()
    assert np.ptp(colours[0]) < np.ptp(colours[15])


def test_the_dark_have_no_swarm():
    lit = LIT.copy()
    lit[:5] = False
    swarm = np.full(600, 3, np.int32)
    colours = Palette(600).colours(swarm, lit)
    assert (colours[:5] == DARK).all()
    assert (colours[5:] == CALM).all()
    assert (Palette(600).colours(swarm, ~LIT) == DARK).all()
    only = ~LIT
    only[0] = True
    assert Palette(600).colours(swarm, only)[0].tolist() == swarm_colours(np.array([3]), PALE)[0].tolist()
