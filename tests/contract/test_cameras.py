"""Both camera stacks against their fakes: pictures arrive whole, in order, in time."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import aravis, pylon
from drivers.catalogue import PylonSettings
from drivers.frame_counter import FrameCounter
from drivers.region_grid import RegionGrid
from fakes.camera import cameras, pylon_camera
from fakes.camera.gige_camera import GigeCamera
from fakes.camera.render import Renderer
from fakes.camera.scene import SnapshotWriter, pictures
from fakes.testing import FakeProcess, free_loopback
from fakes.world.layout import Layout
from fakes.world.world import WorldSnapshot
from vgrd.clock import SystemClock
from vgrd.devices import Region
from vgrd.errors import BadReading, ConfigError, DeviceRefused, DeviceUnavailable
from vgrd.vision.images.pictures import as_8_bit

CLOCK = SystemClock()
SIZE = (4024, 3036)


def have_aravis():
    return cameras.choose().driver == "aravis"


needs_aravis = pytest.mark.skipif(not have_aravis(), reason="Aravis does not load here")


class Shown:
    """Random pictures; remembers the last one shown and when."""

    def __init__(self):
        rng = np.random.default_rng(5)
        self.stock = rng.integers(0, 256, (3, SIZE[1], SIZE[0]), dtype=np.uint8)
        self.count = 0

    def __call__(self, region=None):
        """Show the next one."""
        self.count += 1
        self.at_s = CLOCK.monotonic()
        self.last = self.stock[self.count % 3]
        return self.last if region is None else self.last[region.slices]


@pytest.fixture(scope="module")
def stock():
    return Shown()


@pytest.fixture
def gige(stock):
    with GigeCamera(stock, free_loopback(3956), SIZE) as fake:
        camera = aravis.open({"address": fake.host, "packet_bytes": 16000}, CLOCK)
        yield fake, camera
        camera.close()


@needs_aravis
def test_twelve_megapixels_arrive_byte_for_byte_and_frames_advance(stock, gige):
    frames = []
    for _ in range(5):
        before_s = CLOCK.monotonic()
        image = gige[1].grab(2.0)
        assert np.array_equal(image.pixels, stock.last)
        assert before_s < image.stamp_s < CLOCK.monotonic() + 0.01
        assert abs(image.stamp_s - 0.005 - stock.at_s) < 0.05  # exposure of the fake: 10 ms
        frames.append(image.frame)
    assert frames == [1, 2, 3, 4, 5]


REGION = Region(1001, 502, 803, 604)


@needs_aravis
def test_a_region_comes_with_its_place_and_the_whole_picture_after_it(stock, gige):
    frames = []
    for region in (None, REGION, REGION, Region(3900, 3000, 500, 500), None):
        image = gige[1].grab(2.0, region)
        frames.append(image.frame)
        if region is None:
            assert image.region is None
            assert np.array_equal(image.pixels, stock.last)
            continue
        part = image.region
        rows, columns = slice(part.y, part.y + part.height), slice(part.x, part.x + part.width)
        assert np.array_equal(image.pixels, stock.stock[stock.count % 3][rows, columns])
    assert frames == [1, 2, 3, 4, 5]


@needs_aravis
def test_a_camera_that_a_killed_driver_left_with_a_region_sends_whole_pictures_again(stock):
    with GigeCamera(stock, free_loopback(3956), SIZE) as fake:
        settings = {"address": fake.host, "packet_bytes": 16000}
        first = aravis.open(settings, CLOCK)
        assert first.grab(2.0, REGION).region is not None
        first.close()
        second = aravis.open(settings, CLOCK)
        image = second.grab(2.0)
        assert np.array_equal(image.pixels, stock.last)
        assert (image.region, image.pixels.shape) == (None, SIZE[::-1])
        second.close()


def test_pylons_camera_sends_regions_and_its_frames_advance(monkeypatch):
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    camera = pylon.open({"exposure_ms": 5.0}, CLOCK)
    try:
        whole = camera.grab(2.0)
        asked = Region(101, 52, 303, 204)
        images = [camera.grab(2.0, asked), camera.grab(2.0, asked), camera.grab(2.0)]
    finally:
        camera.close()
    for image in images[:2]:
        assert image.pixels.shape == (image.region.height, image.region.width)
        assert image.pixels.size < whole.pixels.size
    assert (images[2].region, images[2].pixels.shape) == (None, whole.pixels.shape)
    assert [image.frame for image in (whole, *images)] == [1, 2, 3, 4]


@given(
    st.tuples(*(st.integers(1, 16) for _ in range(4))),
    st.tuples(st.integers(-50, 4100), st.integers(-50, 3100)),
    st.tuples(st.integers(1, 4100), st.integers(1, 3100)),
)
def test_a_region_of_the_grid_holds_what_was_asked_or_there_is_none(steps, start, size):
    grid = RegionGrid(Region(0, 0, 4024, 3036), *steps)
    region = grid.around(Region(*start, *size))
    if region is None:
        return
    assert (region.x % steps[0], region.y % steps[1]) == (0, 0)
    assert (region.width % steps[2], region.height % steps[3]) == (0, 0)
    assert 0 <= region.x <= max(start[0], 0)
    assert 0 <= region.y <= max(start[1], 0)
    assert min(start[0] + size[0], 4024) <= region.x + region.width <= 4024
    assert min(start[1] + size[1], 3036) <= region.y + region.height <= 3036


@needs_aravis
def test_deep_pictures_of_every_format_have_one_scale_and_a_hot_pixel_changes_no_other(stock):
    shown = stock.stock[0][:300, :400] // 3
    hot = shown.copy()
    hot[7, 9] = 255
    pictures = iter([shown, hot, shown])
    with GigeCamera(lambda _: next(pictures), free_loopback(3956), (400, 300)) as fake:
        camera = aravis.open({"address": fake.host, "pixel_format": "Mono16"}, CLOCK)
        taken = []
        for fake.faults.twelve in (False, False, True):
            taken.append(camera.grab(2.0).pixels)
        camera.close()
    for pixels, levels in zip(taken, (shown, hot, shown), strict=True):
        assert pixels.dtype == np.uint16
        assert np.array_equal(pixels, levels.astype(np.uint16) << 8)
        assert np.abs(as_8_bit(pixels).astype(int) - levels).max() <= 1


@needs_aravis
def test_lost_packets_are_sent_again(stock, gige):
    fake, camera = gige
    fake.faults.lost = 0.02
    assert np.array_equal(camera.grab(2.0).pixels, stock.last)


@needs_aravis
def test_an_incomplete_picture_is_a_bad_reading_and_the_next_one_is_good(stock, gige):
    fake, camera = gige
    fake.faults.lost, fake.faults.resend = 0.3, False
    with pytest.raises(BadReading, match="incomplete"):
        camera.grab(2.0)
    fake.faults.lost, fake.faults.resend = 0.0, True
    assert np.array_equal(camera.grab(2.0).pixels, stock.last)


@needs_aravis
def test_a_frozen_camera_is_unavailable_in_time(gige, stopwatch):
    fake, camera = gige
    fake.faults.freeze = True
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable, match="no picture within"):
        camera.grab(0.3)
    stopwatch.judge("it is told", time.monotonic() - start, 0.6)
    camera.close()
    with pytest.raises(DeviceUnavailable, match="closed"):
        camera.grab(0.3)


@needs_aravis
def test_a_frame_number_that_stands_still_is_a_bad_reading(gige):
    fake, camera = gige
    camera.grab(2.0)
    fake.faults.repeat = True
    with pytest.raises((BadReading, DeviceUnavailable)):
        camera.grab(0.5)


@needs_aravis
def test_wrong_settings_are_refused_by_name():
    with pytest.raises(ConfigError, match="adress: unknown key, did you mean 'address'"):
        aravis.open({"adress": "127.0.0.3"}, CLOCK)
    fake = GigeCamera(Shown(), free_loopback(3956), SIZE)
    with fake:
        settings = {"address": fake.host, "pixel_format": "Mono7"}
        with pytest.raises(ConfigError, match="pixel_format: 'Mono7': take one of Mono8"):
            aravis.open(settings, CLOCK)
        with pytest.raises(DeviceRefused, match="refuses"):
            aravis.open(settings | {"pixel_format": "Mono14"}, CLOCK)


@needs_aravis
def test_another_camera_at_the_address_is_refused_by_its_serial():
    with GigeCamera(Shown(), free_loopback(3956), SIZE, serial="VGRD0007") as fake:
        aravis.open({"address": fake.host, "serial": "VGRD0007"}, CLOCK).close()
        with pytest.raises(DeviceRefused, match="serial VGRD0007, the settings say VGRD0001"):
            aravis.open({"address": fake.host, "serial": "VGRD0001"}, CLOCK)


@needs_aravis
def test_nobody_at_the_address_is_unavailable():
    with pytest.raises(DeviceUnavailable, match="no camera at"):
        aravis.open({"address": free_loopback(3956)}, CLOCK)


@needs_aravis
def test_a_camera_process_that_dies_is_noticed(stopwatch):
    host = free_loopback(3956)
    with FakeProcess("camera", "--host", host) as process:
        camera = aravis.open({"address": host, "packet_bytes": 16000}, CLOCK)
        assert camera.grab(3.0).pixels.shape == (SIZE[1], SIZE[0])
        process.kill()
        start = time.monotonic()
        with pytest.raises(DeviceUnavailable, match="is lost"):
            camera.grab(0.5)
        camera.close()
        stopwatch.judge("it is told", time.monotonic() - start, 0.8)


def snapshot(exposure):
    flange = Layout().base_from_wrist_home.matrix().ravel().tolist()
    return WorldSnapshot(tuple(flange), 0.1 * exposure, exposure=exposure)


def test_a_picture_shows_the_world_after_the_request_and_a_stopped_world_is_told(tmp_path: Path):
    ring = tmp_path / "world.ring"
    writer = SnapshotWriter(ring)
    writer.publish(snapshot(1), CLOCK.monotonic())
    draw = pictures(ring)
    later = threading.Timer(0.05, lambda: writer.publish(snapshot(2), CLOCK.monotonic()))
    later.start()
    shown = draw(None)
    later.join()
    assert np.array_equal(shown, Renderer(Layout()).render(snapshot(2)))
    with pytest.raises(TimeoutError, match="stopped"):
        draw(None)
    writer.close()


def test_pylons_emulator_shows_one_drawn_picture_per_grab(stock):
    camera = pylon_camera.EmulatedCamera(stock, CLOCK)
    try:
        for number in (1, 2, 3):
            image = camera.grab(5.0)
            assert np.array_equal(image.pixels, stock.last)
            assert image.frame == number
    finally:
        camera.close()


def test_the_pylon_driver_takes_pictures_on_trigger_and_a_closed_camera_is_unavailable(
    monkeypatch,
):
    """Against the emulator's own test picture, whose frame numbers advance while it grabs."""
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    camera = pylon.open({"exposure_ms": 5.0}, CLOCK)
    images = [camera.grab(2.0) for _ in range(3)]
    assert [image.frame for image in images] == [1, 2, 3]
    assert images[0].pixels.ndim == 2
    camera.close()
    camera.close()
    with pytest.raises(DeviceUnavailable):
        camera.grab(0.3)


def test_pylon_gives_every_depth_at_one_scale(monkeypatch):
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    first = []
    for pixel_format in ("Mono8", "Mono10", "Mono12", "Mono16"):
        camera = pylon.open({"pixel_format": pixel_format}, CLOCK)
        first.append(as_8_bit(camera.grab(2.0).pixels).astype(int))
        camera.close()
    assert np.ptp(first[0]) == 255
    for deep in first[1:]:
        assert np.abs(deep - first[0]).max() <= 1


def test_colours_are_refused_with_the_formats_to_choose_from(monkeypatch):
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    with pytest.raises(ConfigError, match="pixel_format: 'BayerRG8': take one of Mono8"):
        pylon.open({"pixel_format": "BayerRG8"}, CLOCK)
    options = PylonSettings(pixel_format="BayerRG8")  # as of a camera that ignores what it is told
    camera = pylon.connect(options)
    pylon.configure(camera, options)
    camera.StartGrabbing()
    with pytest.raises(BadReading, match="choose pixel_format Mono8"):
        pylon.take(camera, 2.0, CLOCK)
    camera.Close()


def test_frame_numbers_count_over_the_wrap_and_refuse_to_stand_still():
    frames = FrameCounter(wrap_at=0xFFFF)
    assert [frames.advance(n) for n in (65534, 65535, 1, 2, 5)] == [1, 2, 3, 4, 7]
    for number in (5, 4):
        with pytest.raises(BadReading, match="frame number"):
            frames.advance(number)
    assert frames.advance(6) > 7
