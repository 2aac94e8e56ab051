"""Whatever is in a file, the reader answers with a cloud or with BadInput."""

import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from swarmer.errors import BadInput
from swarmer.shapes.files import FORMATS, read_cloud

trimesh = pytest.importorskip("trimesh")
BALL = trimesh.creation.icosphere(1)


def whole(suffix):
    file = io.BytesIO()
    if suffix == ".npy":
        np.save(file, BALL.vertices)
    elif suffix == ".mat":
        savemat(file, {"points": np.asarray(BALL.vertices)}, do_compression=True)
    elif suffix in (".off", ".ply", ".obj", ".stl", ".glb"):
        exported = BALL.export(file_type=suffix[1:])
        return exported if isinstance(exported, bytes) else exported.encode()
    else:
        np.savetxt(file, BALL.vertices)
    return file.getvalue()


WHOLE = {suffix: whole(suffix) for suffix in FORMATS}
hostile = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def answers(path, content, points):
    path.write_bytes(content)
    try:
        cloud = read_cloud(path, points)
    except BadInput as error:
        line = str(error)
    else:
        assert len(cloud) >= 2
        assert np.isfinite(cloud.points).all()
        return
    assert "\n" not in line
    assert len(line) < 1000


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", sorted(FORMATS))
@hostile
@given(content=st.binary(max_size=300), points=st.sampled_from([None, 3]))
def test_any_bytes(tmp_path, suffix, content, points):
    answers(tmp_path / f"x{suffix}", content, points)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", sorted(FORMATS))
@hostile
@given(data=st.data(), points=st.sampled_from([None, 3]))
def test_a_good_file_damaged(tmp_path, suffix, data, points):
    content = bytearray(WHOLE[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        if data.draw(st.booleans()):
            content[at] = data.draw(st.integers(0, 255))
        else:
            del content[at : at + data.draw(st.integers(1, 40))]
        if not content:
            break
    answers(tmp_path / f"x{suffix}", bytes(content), points)


@hostile
@given(text=st.text(alphabet="0123456789.,;-+eE#/ \n\tnaif_x", max_size=200))
def test_any_text(tmp_path, text):
    for suffix in (".txt", ".xyz"):
        answers(tmp_path / f"x{suffix}", text.encode(), None)
