"""A GigE Vision camera on a loopback address: control (GVCP) on UDP 3956, pictures (GVSP).

Registers and the GenICam description are those of Aravis' `ArvFakeCamera`; the network side is
here, because Aravis' own fake binds only to addresses that an interface carries (127.0.0.1: one
camera per machine), sends no packet twice and looks for triggers every 40 ms. Here every 127.x.y.z
is a camera, so parallel runs do not meet. Pictures are made and sent by a thread of their own:
control (heartbeat, resend) is answered while a picture is drawn, and no foreign thread waits for
the GIL.
"""

import ctypes
import queue
import random
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from ctypes import c_char_p, c_int, c_size_t, c_uint32, c_void_p
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.aravis_library import Library, load
from fakes.camera.sensor import Picture, PixelRegion

PORT = 3956  # of GVCP

_DISCOVERY, _RESEND = 0x0002, 0x0040  # commands of GVCP (GigE Vision)
_READ_REGISTER, _WRITE_REGISTER = 0x0080, 0x0082  # idem
_READ_MEMORY, _WRITE_MEMORY = 0x0084, 0x0086  # idem
_DISCOVERY_BYTES = 0xF8  # of the answer to a discovery (idem)
_IP, _CAPABILITY, _PRIVILEGE = 0x0024, 0x0934, 0x0A00  # bootstrap registers of GigE Vision
_STREAM_PORT, _STREAM_PACKET, _STREAM_IP = 0x0D00, 0x0D04, 0x0D18  # SCP0, SCPS0, SCDA0 (idem)
_FIRE_TEST = 1 << 31  # bit of SCPS0: send a test packet
_CAN_RESEND = 1 << 2  # bit of the GVCP capability: packets are sent again
_WIDTH, _HEIGHT, _SENSOR_HEIGHT, _SENSOR_WIDTH = 0x100, 0x104, 0x118, 0x11C  # as ArvFakeCamera
_OFFSET_X, _OFFSET_Y = 0x130, 0x134  # as Aravis' ArvFakeCamera
_PIXEL_FORMAT = 0x128  # as Aravis' ArvFakeCamera
_MONO8, _MONO12, _MONO16 = 0x01080001, 0x01100005, 0x01100007  # GenICam's PFNC
_LEADER, _TRAILER, _PAYLOAD = 1, 2, 3  # packet formats of GVSP
_HEADERS_BYTES = 20 + 8 + 8  # IP, UDP, GVSP
_FIRST_FRAME = 65400  # soon over the wrap of 16 bits
_SEND_BUFFER = 1 << 22  # 4 MiB: hundreds of packets, so that the sender seldom waits
_WAKE_S = 0.1  # then a thread looks whether it is to end; no test notices so short a wait
_LINK_BYTES_PER_S = 250e6  # twice gigabit Ethernet: 12 megapixels take 50 ms
_BURST_S = 0.25e-3  # 62 kB: what is ahead of the link fits into a receiver's buffer


@dataclass(slots=True)
class CameraFaults:
    """Faults to switch on.

    freeze: answer control, send no picture; lost: share of packets that do not arrive at first;
    resend: whether they are sent again when asked for; repeat: keep the frame number; twelve: send
    12 bits where 16 were asked for.
    """

    freeze: bool = False
    lost: float = 0.0
    resend: bool = True
    repeat: bool = False
    twelve: bool = False


class GigeCamera:
    """A camera of `size_px` (width, height) that shows what `image_source` returns at a trigger.

    `with` starts and stops it. image_source: gets the region that the client has set, None for the
    whole picture, and returns (height, width) uint8; called in the stream's thread; on its
    TimeoutError no picture is sent.
    """

    def __init__(
        self,
        image_source: Callable[[PixelRegion | None], Picture],
        host: str,
        size_px: tuple[int, int],
        serial: str = "VGRD0001",
    ) -> None:
        self.faults = CameraFaults()
        self.host = host
        self._source = image_source
        self._size_px = size_px
        self._registers = _Registers(load(), serial)
        self._triggers: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._stopped = threading.Event()
        self._frame: _Frame | None = None
        self._number = _FIRST_FRAME
        self._luck = random.Random(0)

    def __enter__(self) -> "GigeCamera":
        self._control = self._bound(PORT)
        self._stream = self._bound(0)
        self._stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        registers = self._registers
        registers.write_memory(_IP, socket.inet_aton(self.host))
        registers[_CAPABILITY] |= _CAN_RESEND
        registers[_SENSOR_WIDTH], registers[_SENSOR_HEIGHT] = self._size_px
        registers[_WIDTH], registers[_HEIGHT] = self._size_px
        self._threads = [
            threading.Thread(target=run, name=run.__name__, daemon=True)
            for run in (self._serve_control, self._serve_stream)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def _bound(self, port: int) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.bind((self.host, port))
        opened.settimeout(_WAKE_S)
        return opened

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._triggers.put(False)
        for thread in self._threads:
            thread.join()
        self._control.close()
        self._stream.close()

    def _serve_control(self) -> None:
        while not self._stopped.is_set():
            try:
                packet, peer = self._control.recvfrom(65536)
            except TimeoutError:
                continue
            kind, _, command, size, identity = struct.unpack_from(">BBHHH", packet)
            if kind != 0x42 or len(packet) < 8 + size:
                continue
            answer = self._obey(command, packet[8 : 8 + size])
            if answer is not None:
                head = struct.pack(">HHHH", 0, command + 1, len(answer), identity)
                self._control.sendto(head + answer, peer)
            if command in (_WRITE_REGISTER, _WRITE_MEMORY) and self._registers.take_trigger():
                self._triggers.put(True)

    def _obey(self, command: int, data: bytes) -> bytes | None:
        """Return the payload of the acknowledgement, None where there is none."""
        registers = self._registers
        if command == _DISCOVERY:
            return registers.read_memory(0, _DISCOVERY_BYTES)
        if command == _READ_MEMORY:
            address, size = struct.unpack(">II", data)
            return data[:4] + registers.read_memory(address, size & 0xFFFF)
        if command == _WRITE_MEMORY:
            registers.write_memory(struct.unpack_from(">I", data)[0], data[4:])
            return data[:4]
        if command == _READ_REGISTER:
            addresses = struct.unpack(f">{len(data) // 4}I", data)
            return struct.pack(f">{len(addresses)}I", *(registers[a] for a in addresses))
        if command == _WRITE_REGISTER:
            for address, value in struct.iter_unpack(">II", data):
                registers[address] = value
                if address == _STREAM_PACKET and value & _FIRE_TEST:
                    self._send_test_packet(value & 0xFFFF)
            return struct.pack(">I", len(data) // 8)
        if command == _RESEND:
            self._resend(*struct.unpack_from(">III", data))
        return None

    def _region(self) -> PixelRegion | None:
        """What the client wants to see, None for the whole picture."""
        registers = self._registers
        region = PixelRegion(*(registers[a] for a in (_OFFSET_X, _OFFSET_Y, _WIDTH, _HEIGHT)))
        return None if region == PixelRegion(0, 0, *self._size_px) else region

    def _target(self) -> tuple[str, int]:
        """Where the client wants the stream to go."""
        address = socket.inet_ntoa(self._registers.read_memory(_STREAM_IP, 4))
        return address, self._registers[_STREAM_PORT] & 0xFFFF

    def _send_test_packet(self, size: int) -> None:
        self._stream.sendto(bytes(max(0, size - 28)), self._target())

    def _serve_stream(self) -> None:
        while self._triggers.get():
            try:
                region = self._region()
                image = np.ascontiguousarray(self._source(region), dtype=np.uint8)
            except TimeoutError as error:
                print(f"no picture: {error}", file=sys.stderr, flush=True)
                continue
            if not self.faults.freeze and self._registers.acquiring():
                if not self.faults.repeat:
                    self._number = self._number % 0xFFFF + 1
                size = (self._registers[_STREAM_PACKET] & 0xFFFF) - _HEADERS_BYTES
                origin = (0, 0) if region is None else (region.x, region.y)
                deep, pixel_format = self._deep(image)
                self._frame = _Frame(
                    self._number, time.monotonic_ns(), deep, pixel_format, size, origin
                )
                self._send(self._frame, range(self._frame.blocks), self.faults.lost)

    def _deep(self, image: Picture) -> tuple[NDArray[np.uint8 | np.uint16], int]:
        """The picture with as many bits as asked for, and its pixel format."""
        if self._registers[_PIXEL_FORMAT] != _MONO16:
            return image, _MONO8
        deep = image.astype(np.uint16)
        if self.faults.twelve:
            return np.left_shift(deep, 4, dtype=np.uint16), _MONO12
        return np.left_shift(deep, 8, dtype=np.uint16), _MONO16

    def _resend(self, number: int, first: int, last: int) -> None:
        frame = self._frame
        if self.faults.resend and frame and frame.number == number & 0xFFFF:
            self._send(frame, range(first, min(last, frame.blocks - 1) + 1), 0.0)

    def _send(self, frame: "_Frame", blocks: range, lost: float) -> None:
        """Send blocks at the speed of the link: receivers without privileges have small buffers."""
        target, start_s, sent = self._target(), time.monotonic(), 0
        for block in blocks:
            if self._luck.random() >= lost:
                sent += self._stream.sendmsg(frame.packet(block), (), 0, target)
            ahead_s = sent / _LINK_BYTES_PER_S - (time.monotonic() - start_s)
            if ahead_s > _BURST_S:
                time.sleep(ahead_s)


class _Frame:
    """A picture cut into GVSP packets: leader 0, payload 1 .. n, trailer n + 1."""

    def __init__(
        self,
        number: int,
        stamp_ns: int,
        image: NDArray[np.uint8 | np.uint16],
        pixel_format: int,
        size: int,
        origin: tuple[int, int],
    ) -> None:
        self.number = number
        self._pixels = image.reshape(-1).view(np.uint8).data
        self._size = size
        self.blocks = -(-len(self._pixels) // size) + 2
        height, width = image.shape
        high, low = stamp_ns >> 32, stamp_ns & 0xFFFFFFFF
        self._leader = struct.pack(
            ">HHIIIIIIIHH", 0, 1, high, low, pixel_format, width, height, *origin, 0, 0
        )
        self._trailer = struct.pack(">II", 1, height)

    def packet(self, block: int) -> tuple[bytes | memoryview, ...]:
        """Header and content of one packet."""
        content: bytes | memoryview
        if block == 0:
            kind, content = _LEADER, self._leader
        elif block == self.blocks - 1:
            kind, content = _TRAILER, self._trailer
        else:
            start = (block - 1) * self._size
            kind, content = _PAYLOAD, self._pixels[start : start + self._size]
        return struct.pack(">HHI", 0, self.number, kind << 24 | block), content


class _Registers:
    """The bootstrap and feature registers, held by Aravis' `ArvFakeCamera`."""

    def __init__(self, library: Library, serial: str) -> None:
        declare = library.declare
        declare("arv_fake_camera_new", c_void_p, c_char_p)
        for name in ("read", "write"):
            declare(
                f"arv_fake_camera_{name}_memory", c_int, c_void_p, c_uint32, c_uint32, c_void_p
            )
        declare("arv_fake_camera_check_and_acknowledge_software_trigger", c_int, c_void_p)
        declare("arv_fake_camera_get_acquisition_status", c_uint32, c_void_p)
        declare("arv_fake_camera_get_genicam_xml", c_void_p, c_void_p, ctypes.POINTER(c_size_t))
        self._library = library
        self._camera = library.call("arv_fake_camera_new", serial.encode())
        self._lock = threading.Lock()

    def read_memory(self, address: int, size: int) -> bytes:
        data = ctypes.create_string_buffer(size)
        with self._lock:
            self._library.call("arv_fake_camera_read_memory", self._camera, address, size, data)
        return data.raw

    def write_memory(self, address: int, data: bytes) -> None:
        with self._lock:
            self._library.call(
                "arv_fake_camera_write_memory", self._camera, address, len(data), data
            )

    def __getitem__(self, address: int) -> int:
        return int(struct.unpack(">I", self.read_memory(address, 4))[0])

    def __setitem__(self, address: int, value: int) -> None:
        self.write_memory(address, struct.pack(">I", value))

    def take_trigger(self) -> bool:
        """Tell once that a software trigger has been written."""
        with self._lock:
            name = "arv_fake_camera_check_and_acknowledge_software_trigger"
            return bool(self._library.call(name, self._camera))

    def acquiring(self) -> bool:
        return bool(self._library.call("arv_fake_camera_get_acquisition_status", self._camera))
