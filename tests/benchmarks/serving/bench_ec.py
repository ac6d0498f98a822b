"""One expected coordinate, from pixels to registers, against the bare tag detector on the same picture.

The detector is pyapriltags as its documentation calls it, on the full picture, halved by its own quad_decimate.
"""

import tempfile
import time
from pathlib import Path

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.world import World
from tests.benchmarks.harness import Row, ratio_of
from tests.benchmarks.peers import Peer
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import Limits, answer_request
from vgrd.devices import CameraImage
from vgrd.model import Policy
from vgrd.registers import REQUEST, RegisterImage, Request, State, Status, view
from vgrd.vision.tags.tag_finder import TagDetector

ROUNDS = 15
BAR = 0.5


def rows() -> list[Row]:
    """ec_vs_bare_detector: time of one EC / time of one bare detector call, both cold."""
    with tempfile.TemporaryDirectory() as folder:
        world = World(Layout(), seed=3)
        rehearsal = Rehearsal(world, facts_of(world, Path(folder)))
        calibration = calibrate_system(rehearsal.teach(points=0))
    rehearsal.stand(retracted_pose(), 1.0)
    pixels = rehearsal.picture()
    facts, layout = calibration.facts, world.layout
    tags = [layout.tag_a, layout.tag_b]
    ours = TagDetector(facts.camera_matrix, facts.distortion, tags, facts.image_size_px)
    values = dict.fromkeys((field.name for field in REQUEST.fields), 0)
    request = Request.parse(REQUEST.encode(values | {"TRIG": 1, "CMD": 2, "POINT": 1}), nonce=1)
    limits = Limits(Policy.FIXED, 3.0, 2.0, 2.0, 0.3)
    flange = world.reported_flange(rehearsal.now_s)

    def served() -> float:
        start = time.perf_counter()
        seen = ours.detect(pixels)
        now = time.monotonic()
        sight = Sight(CameraImage(pixels, now, 1), seen[0], seen[1], flange, None)
        answer, _ = answer_request(request, calibration, 1, sight, limits, now, time.time())
        image = RegisterImage(answer, State.READY, 1, now)
        image = RegisterImage.unpack(image.pack())
        registers = view(image, now, deadline_s=0.25, answered=request).response
        assert (answer.status, len(registers)) == (Status.OK, 136)
        return time.perf_counter() - start

    with Peer("pyapriltags", nthreads=1, quad_decimate=2.0) as bare:
        assert bare.keep(pixels) == 2
        ratio, ours_s, bare_s = ratio_of(served, bare.seconds, ROUNDS)
    note = f"{1e3 * ours_s:.0f} ms against {1e3 * bare_s:.0f} ms, 12 MP, both tags, cold"
    return [Row.at_most("ec_vs_bare_detector", ratio, "x", BAR, note)]
