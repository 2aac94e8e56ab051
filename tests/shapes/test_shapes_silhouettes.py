"""A picture's silhouette, and the lights on it."""

import io
import struct
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes import picture_files
from swarmer.shapes.errors import BadShape
from swarmer.shapes.picture_files import read_silhouette, silhouette_cloud
from swarmer.shapes.sampling import gap_share


def png(image, **more):
    file = io.BytesIO()
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(file, "PNG", **more)
    return file.getvalue()


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def headed(width, height):
    """A PNG that is no more than its header."""
    return picture_files.SIGNATURE + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))


def disc(size=200, radius=60, at=(100, 100)):
    row, column = np.mgrid[:size, :size] + 0.5
    return np.hypot(column - at[0], row - at[1]) < radius


def grey(mask, dark, light, kind=np.uint8):
    return np.where(mask, dark, light).astype(kind)


ROUND = disc()


# -- what is drawn ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "LA"])
def test_what_is_dark_on_a_light_ground_is_drawn(mode):
    image = Image.fromarray(grey(ROUND, 0, 255)).convert(mode)
    np.testing.assert_array_equal(read_silhouette(png(image)), ROUND)
    np.testing.assert_array_equal(read_silhouette(png(image), invert=True), ~ROUND)


def test_sixteen_bits_a_pixel_are_not_cut_off():
    image = grey(ROUND, 20_200, 40_000, np.uint16)  # by their lower bytes it would be the other way round
    np.testing.assert_array_equal(read_silhouette(png(image)), ROUND)


def test_the_threshold_is_between_the_shades_wherever_they_are():
    noise = np.random.default_rng(3).integers(-9, 10, ROUND.shape)
    for dark, light in ((10, 60), (180, 240), (100, 140)):
        np.testing.assert_array_equal(
            read_silhouette(png(grey(ROUND, dark, light) + noise.astype(np.uint8))), ROUND
        )


def test_what_is_opaque_is_drawn_where_there_is_transparency_be_it_light_or_dark():
    shades = np.random.default_rng(4).integers(0, 256, (*ROUND.shape, 3))
    image = np.dstack([shades, np.where(ROUND, 255, 30)]).astype(np.uint8)
    np.testing.assert_array_equal(read_silhouette(png(image)), ROUND)
    np.testing.assert_array_equal(read_silhouette(png(image), invert=True), ~ROUND)


def test_a_colour_that_stands_for_transparency_counts_as_such():
    image = Image.fromarray(grey(ROUND, 200, 255))
    np.testing.assert_array_equal(read_silhouette(png(image, transparency=255)), ROUND)


def refusal(data, invert=False):
    with pytest.raises(BadShape) as caught:
        read_silhouette(data, invert)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 200
    return line


def test_a_picture_without_a_drawing_is_refused():
    white = np.full((9, 9), 255, dtype=np.uint8)
    assert "nothing is drawn" in refusal(png(white))
    assert "all of the picture" in refusal(png(white), invert=True)
    clear = np.zeros((9, 9, 4), dtype=np.uint8)
    assert "nothing is drawn" in refusal(png(clear))


@pytest.mark.parametrize("data", [b"", b"GIF89a" + bytes(40), b"\xff\xd8\xff\xe0 a photograph"])
def test_what_is_no_png_is_refused(data):
    assert "not a PNG" in refusal(data)


def test_every_cut_of_a_picture_is_refused():
    whole = png(np.random.default_rng(5).integers(0, 256, (20, 20)).astype(np.uint8))
    for end in range(8, len(whole) - 24, 7):  # the last bytes are checksums, and say that it ends
        assert "damaged" in refusal(whole[:end])


def test_a_large_picture_is_refused_by_its_header_before_anything_is_unpacked(monkeypatch):
    monkeypatch.setattr(picture_files, "_decoded", lambda data: pytest.fail("it was unpacked"))
    assert "4,001 x 4,000 pixels; at most 16,000,000" in refusal(headed(4001, 4000))
    assert "pixels" in refusal(headed(2**31 - 1, 2**31 - 1))
    assert "empty picture, 0 x 7" in refusal(headed(0, 7))
    monkeypatch.setattr(picture_files, "FILE_BYTES_MAX", 100)
    assert "101 bytes" in refusal(headed(9, 9).ljust(101))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_picture_gives_a_mask_or_one_line(data):
    content = bytearray(png(grey(disc(40, 12, (20, 20)), 20, 230)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(8, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        mask = read_silhouette(bytes(content))
    except BadShape as error:
        line = str(error)
    else:
        assert mask.any()
        assert not mask.all()
        return
    assert "\n" not in line


# -- lights on it ----------------------------------------------------------------------------------------------------


def gaps(points):
    return np.asarray(cKDTree(points).query(points, k=[2])[0]).ravel()


@pytest.mark.parametrize("count", [2, 3, 40, 300, 5000])
def test_a_disc_has_exactly_so_many_lights_inside_of_it(count):
    points = silhouette_cloud(ROUND, count, seed=1)
    assert points.shape == (count, 2)
    assert len(np.unique(points, axis=0)) == count
    assert np.hypot(*(points - 100).T).max() < 61
    ideal = np.sqrt(2 * np.pi * 60**2 / (np.sqrt(3) * count))
    assert gaps(points).min() > 0.5 * ideal


def test_many_lights_have_a_wide_pool_to_be_chosen_from():
    points = silhouette_cloud(ROUND, 22_375, seed=1)
    assert gap_share(points, ROUND.sum()) > 0.69


def test_its_outline_is_an_even_ring():
    points = silhouette_cloud(ROUND, 300, seed=1) - 100
    rim = points[np.hypot(*points.T) > 58.5]
    turns = np.sort(np.arctan2(rim[:, 1], rim[:, 0]))
    steps = np.diff(np.append(turns, turns[0] + 2 * np.pi))
    assert len(rim) > 45
    assert steps.max() < 1.25 * steps.min()


def test_up_is_up_and_right_is_right():
    corner = np.zeros((50, 80), dtype=bool)
    corner[4:10, 70:78] = True  # top right
    points = silhouette_cloud(corner, 12, seed=0)
    assert points[:, 0].min() >= 69.5
    assert points[:, 1].min() >= 39.5
    assert points.max(axis=0) == pytest.approx((77.5, 46), abs=1)


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_thin_stroke_is_one_row_of_lights(width):
    image = Image.new("L", (400, 300), 255)
    ImageDraw.Draw(image).line((20, 30, 370, 260), fill=0, width=width)
    points = silhouette_cloud(read_silhouette(png(image)), 40, seed=2)
    along = np.array([350.0, -230.0]) / np.hypot(350, 230)  # up is up
    place = np.sort(points @ along)
    assert np.ptp(points @ np.array([-along[1], along[0]])) < width + 1.5
    # a drawn line of 419 pixels: every stretch has its lights
    assert np.ptp(place) > 390
    assert np.diff(place).max() < 2 * 419 / 40


def test_a_hole_stays_open_and_a_stroke_beside_a_large_area_is_not_lost():
    image = Image.fromarray(grey(disc(300, 90, (120, 150)) & ~disc(300, 40, (120, 150)), 0, 255))
    ImageDraw.Draw(image).line((280, 20, 280, 280), fill=0, width=1)
    points = silhouette_cloud(read_silhouette(png(image)), 400, seed=3)
    out = np.hypot(*(points - (120, 150)).T)
    assert ((out > 39) & (out < 91) | (points[:, 0] > 270)).all()
    assert np.sum(np.abs(out - 40) < 1.5) > 25
    stroke = np.sort(points[points[:, 0] > 270][:, 1])
    assert np.diff(stroke).max() < 3 * gaps(points).min()


def test_the_same_seed_gives_the_same_lights_and_another_seed_others():
    one, again, other = (silhouette_cloud(ROUND, 90, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_a_picture_finer_than_needed_is_taken_coarser_and_keeps_its_place_and_strokes():
    mask = disc(1501, 500, (750, 750))
    mask[20, 40:1400] = True
    points = silhouette_cloud(mask, 500, seed=4)
    stroke = points[points[:, 1] > 1400]
    assert np.abs(stroke[:, 1] - 1480.5).max() < 2.5
    assert np.ptp(stroke[:, 0]) > 1300
    assert points[points[:, 1] < 1400].mean(axis=0) == pytest.approx((750, 751), abs=8)


def test_the_last_row_and_column_of_a_large_picture_are_not_cut_off():
    mask = np.zeros((1025, 1025), dtype=bool)
    mask[-1, :300] = mask[:300, -1] = True
    points = silhouette_cloud(mask, 60, seed=1)
    assert ((points[:, 0] >= 1023) ^ (points[:, 1] <= 2)).all()
    assert np.ptp(points, axis=0).min() > 1000


def test_one_pixel_and_dust_carry_lights_too():
    dot = np.zeros((30, 40), dtype=bool)
    dot[3, 4] = True
    points = silhouette_cloud(dot, 60, seed=0)
    assert np.abs(points - (4.5, 26.5)).max() <= 0.5
    dust = np.random.default_rng(6).random((1000, 1000)) < 0.1
    assert len(np.unique(silhouette_cloud(dust, 700, seed=0), axis=0)) == 700


@pytest.mark.parametrize("count", [-1, 0, 1, 10_000_001])
def test_an_impossible_count_is_refused(count):
    with pytest.raises(BadInput, match="points"):
        silhouette_cloud(ROUND, count, seed=0)


def test_lights_on_nothing_are_refused():
    with pytest.raises(BadShape, match="nothing is drawn"):
        silhouette_cloud(np.zeros((5, 5), dtype=bool), 4, seed=0)
