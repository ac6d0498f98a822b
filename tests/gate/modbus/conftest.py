"""A server that serves, and pymodbus's client as oracle."""

import pytest
from pymodbus.client import ModbusTcpClient

from tests.gate.modbus.server import ServerThread


@pytest.fixture
def serving(tmp_path):
    with ServerThread(tmp_path) as made:
        yield made


@pytest.fixture
def oracle(serving):
    client = ModbusTcpClient("127.0.0.1", port=serving.port, timeout=2, retries=0)
    assert client.connect()
    yield client
    client.close()
