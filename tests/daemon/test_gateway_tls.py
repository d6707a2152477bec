"""The network configuration of docs/zenoh.md, as it stands there, with certificates made here."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from hil.client import RigClient
from hil.daemon.gateway.gateway import GatewayOptions
from hil.errors import RigNotReached
from tests.daemon.gateway_rig import RunningGateway, free_port, plain, rig_at, until

PAGE = Path(__file__).parents[2] / "docs" / "zenoh.md"
NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the openssl tool")


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


def authority(folder: Path) -> Path:
    folder.mkdir()
    openssl(
        folder, "req", "-x509", *NEW_KEY, "-keyout", "ca.key", "-out", "ca.pem", "-days", "1",
        "-subj", "/CN=rig authority",
    )  # fmt: skip
    return folder


def certificate(folder: Path, name: str) -> None:
    openssl(
        folder, "req", *NEW_KEY, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj",
        f"/CN={name}",
    )  # fmt: skip
    (folder / f"{name}.ext").write_text(
        "subjectAltName=IP:127.0.0.1\nextendedKeyUsage=serverAuth,clientAuth\n"
    )
    openssl(
        folder, "x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
        "-CAcreateserial", "-days", "1", "-extfile", f"{name}.ext", "-out", f"{name}.pem",
    )  # fmt: skip


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = authority(tmp_path_factory.mktemp("pki") / "rig")
    for name in ("daemon", "simulator", "desk", "visitor"):
        certificate(folder, name)
    stranger = authority(folder.parent / "stranger")
    certificate(stranger, "simulator")
    shutil.copy(folder / "ca.pem", stranger / "ca.pem")
    return folder


def from_page(place: int, folder: Path, name: str, out: Path) -> Path:
    """The JSON5 block `place` of the page, with its paths turned to `folder`."""
    block = re.findall(r"```json5\n(.*?)```", PAGE.read_text(), re.DOTALL)[place]
    assert "/etc/hil/tls/" in block
    text = block.replace("/etc/hil/tls/simulator", f"{folder}/{name}")
    out.write_text(text.replace("/etc/hil/tls", str(folder)))
    return out


@pytest.fixture
def running(keys, tmp_path):
    port = free_port()
    rig = rig_at(
        port,
        tmp_path,
        listen=(f"tls/127.0.0.1:{port}",),
        config=str(from_page(0, keys, "daemon", tmp_path / "daemon.json5")),
    )
    one = RunningGateway(rig, GatewayOptions(is_recording=False, command_timeout_s=1.0))
    try:
        one.wait_ready()
        yield one
    finally:
        one.close()


def client(running, folder, name, tmp_path):
    file = from_page(1, folder, name, tmp_path / f"{name}.json5")
    return RigClient("motorcycle", running.endpoint, name=name, config=file, timeout_s=0.7)


def test_the_simulator_cues_and_sees_but_may_not_command(running, keys, tmp_path):
    with client(running, keys, "simulator", tmp_path) as rig:
        assert rig.is_alive()
        rig.cue(roll=0.02)
        assert until(running.control.cues)[0].client.startswith("simulator")
        states = rig.states()
        running.control.state("parked")
        assert next(states).state == "parked"
        with pytest.raises(RigNotReached, match="nobody answered"):
            rig.command("arm")
    assert running.control.commands() == []


def test_the_desk_commands_but_may_not_cue(running, keys, tmp_path):
    with client(running, keys, "desk", tmp_path) as rig:
        assert rig.command("arm").ok
        rig.cue(roll=0.02)
        assert rig.command("park").ok
        time.sleep(0.05)
    assert running.control.cues() == []


def test_a_certificate_without_a_role_sees_nothing(running, keys, tmp_path):
    with pytest.raises(RigNotReached), client(running, keys, "visitor", tmp_path):
        pass


def test_a_certificate_of_another_authority_does_not_get_in(running, keys, tmp_path):
    stranger = keys.parent / "stranger"
    with (
        pytest.raises(RigNotReached, match="no daemon"),
        client(running, stranger, "simulator", tmp_path),
    ):
        pass


def test_without_tls_nobody_gets_in(running):
    endpoint = running.endpoint.replace("tls/", "tcp/")
    with (
        pytest.raises(RigNotReached, match="no daemon"),
        RigClient("motorcycle", endpoint, timeout_s=0.3),
    ):
        pass


def test_the_page_names_every_key_and_command_that_there_is():
    from hil.daemon.gateway.commands import COMMANDS

    text = PAGE.read_text()
    for command in COMMANDS:
        assert f"`{command}`" in text
    for tail in ("cue", "state", "event", "drive/<actuator>", "schema/<name>", "alive"):
        assert f"`hil/<rig>/{tail}`" in text


def test_the_cue_and_the_state_of_the_page_are_what_the_gateway_speaks(tmp_path):
    from hil.messages import StateMessage, decode, decode_cue
    from tests.daemon.gateway_rig import gateway

    cue, state = re.findall(r"```json\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert decode_cue(cue.encode(), ("yaw", "pitch", "roll"), "page", 0.0).seq == 17
    assert decode(state.encode(), StateMessage).state == "engaged"
    with gateway(tmp_path, GatewayOptions(is_recording=False)) as one, plain(one.endpoint) as any_:
        any_.put("cue", cue.encode())
        until(one.control.cues)
