"""What `robolamp emulate` can do beside the lamp: bare servos, new servos, faults, links, traffic."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest
from dynamixel_sdk import COMM_SUCCESS
from sleeper import bears, eventually

from robolamp.emulator.bare_servos_file import load_servos
from robolamp.errors import FileError

from .test_process import COMMAND, emulator, sdk

TWO = """
name = "two"
[[servo]]
model = "XL430-W250-T"
id = 4
baud = 57600
[[servo]]
model = "XL330-M077-T"
id = 5
baud = 1_000_000
position = 1.0
"""


@pytest.fixture
def two(tmp_path: Path) -> str:
    path = tmp_path / "two.toml"
    path.write_text(TWO)
    return str(path)


@pytest.mark.realtime
def test_servos_of_two_rates_share_a_line(two: str) -> None:
    with emulator("--servos", two) as (_, ready):
        port = str(ready["servo_port"])
        with sdk(port, 57_600) as (handler, packets):
            assert packets.ping(handler, 4)[:2] == (1060, COMM_SUCCESS)
            assert packets.ping(handler, 5)[1] != COMM_SUCCESS
        with sdk(port, 1_000_000) as (handler, packets):
            assert packets.ping(handler, 5)[:2] == (1190, COMM_SUCCESS)
            assert abs(packets.read4ByteTxRx(handler, 5, 132)[0] - 652) <= 2
            assert packets.write1ByteTxRx(handler, 5, 64, 1) == (COMM_SUCCESS, 0)
            packets.write4ByteTxRx(handler, 5, 116, 2000)
            assert eventually(lambda: abs(packets.read4ByteTxRx(handler, 5, 132)[0] - 2000) < 40)


@pytest.mark.realtime
def test_eeprom_is_kept_where_asked(two: str, tmp_path: Path) -> None:
    kept = str(tmp_path / "eeprom")
    for expected, written in ((0, 123), (123, 7)):
        with emulator("--servos", two, "--eeprom", kept) as (process, ready):
            with sdk(str(ready["servo_port"])) as (handler, packets):
                assert packets.read4ByteTxRx(handler, 5, 20)[0] == expected
                assert packets.write4ByteTxRx(handler, 5, 20, written) == (COMM_SUCCESS, 0)
            process.terminate()
            assert process.wait(timeout=60) == 0


@pytest.mark.realtime
def test_a_lamps_eeprom_is_kept_where_asked(tmp_path: Path) -> None:
    kept = tmp_path / "eeprom"
    for expected, written in ((0, 55), (55, 0)):
        with emulator("--reality", "random:7", "--eeprom", str(kept)) as (process, ready):
            with sdk(str(ready["servo_port"])) as (handler, packets):

                def turned(handler=handler, packets=packets, written=written) -> bool:
                    return packets.write4ByteTxRx(handler, 2, 20, written) == (COMM_SUCCESS, 0)

                def reads(handler=handler, packets=packets, expected=expected) -> bool:
                    return packets.read4ByteTxRx(handler, 2, 20)[:2] == (expected, COMM_SUCCESS)

                assert eventually(reads)
                assert eventually(turned)
            process.terminate()
            assert process.wait(timeout=60) == 0
    assert [path.name for path in kept.iterdir()] == ["knee.toml"]


@pytest.mark.realtime
def test_new_servos_are_plugged_in_one_at_a_time(two: str) -> None:
    with (
        emulator("--servos", two, "--factory") as (process, ready),
        sdk(str(ready["servo_port"]), 57_600) as (handler, packets),
    ):
        assert packets.ping(handler, 1)[:2] == (1060, COMM_SUCCESS)
        assert packets.read1ByteTxRx(handler, 1, 9)[0] == 250
        packets.write1ByteTxRx(handler, 1, 7, 11)
        assert eventually(lambda: packets.ping(handler, 11)[0] == 1060)
        assert packets.ping(handler, 1)[1] != COMM_SUCCESS
        process.send_signal(signal.SIGUSR1)
        assert eventually(lambda: packets.ping(handler, 1)[0] == 1190)
        assert packets.ping(handler, 11)[0] == 1060


@pytest.mark.realtime
@bears(0.02)
def test_a_port_is_unplugged_and_comes_back_under_its_link(two: str, tmp_path: Path) -> None:
    script, ports, log = tmp_path / "faults.toml", tmp_path / "ports", tmp_path / "injections.jsonl"
    script.write_text('name = "x"\n[[event]]\nwhat = "unplugged"\nat = 2.0\nlasts = 1.0\n')
    arguments = ("--servos", two, "--faults", str(script), "--ports", str(ports), "--injections", str(log))
    with emulator(*arguments) as (process, ready):
        link = ports / "servo"
        assert ready["servo_port"] == str(link)
        with sdk(str(link)) as (handler, packets):
            assert packets.ping(handler, 5)[1] == COMM_SUCCESS
            assert eventually(lambda: not link.is_symlink())
            with pytest.raises(OSError, match=r".+"):
                handler.writePort(b"\x00" * 8)
        assert eventually(link.is_char_device)
        with sdk(str(link)) as (handler, packets):
            assert packets.ping(handler, 5)[1] == COMM_SUCCESS
        process.terminate()
        assert process.wait(timeout=60) == 0
    assert not link.is_symlink()
    injected = [json.loads(line) for line in log.read_text().splitlines()]
    assert injected == [
        {"time": 2.0, "what": "unplugged", "where": "servo port"},
        {"time": 3.0, "what": "unplugged over", "where": "servo port"},
    ]


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR2, signal.SIGALRM]
)
def test_any_ending_signal_takes_the_ports_away(two: str, tmp_path: Path, number: signal.Signals) -> None:
    ports = tmp_path / "ports"
    with emulator("--servos", two, "--ports", str(ports)) as (process, ready):
        assert (ports / "servo").is_symlink()
        process.send_signal(number)
        assert process.wait(timeout=10) == 0
    assert [path.name for path in ports.iterdir()] == [".lock"]
    assert ready["servo_port"] == str(ports / "servo")


@pytest.mark.realtime
@bears(0.01)
def test_traffic_is_told_in_words(two: str) -> None:
    process = subprocess.Popen(
        [*COMMAND, "--json", "--traffic", "--servos", two], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        ready = json.loads(process.stdout.readline())
        with sdk(ready["servo_port"]) as (handler, packets):
            packets.write2ByteTxRx(handler, 5, 84, 321)
            packets.read2ByteTxRx(handler, 5, 84)
            packets.write1ByteTxRx(handler, 5, 84, 1)
        process.terminate()
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate(timeout=60)
    words = [" ".join(line.split()[1:]) for line in said.splitlines()]
    assert words == [
        "> 5 write Position P Gain(84) 321",
        "< 5 ok",
        "> 5 read Position P Gain(84), 2 bytes",
        "< 5 ok Position P Gain(84) 321",
        "> 5 write Position P Gain(84) 01",
        "< 5 error length",
    ]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--servos", "TWO", "--reality", "worn"], "--reality: cannot be used with --servos"),
        (["--servos", "TWO", "--eeprom", "/proc/none"], "/proc/none: cannot keep EEPROM here"),
        (["--eeprom", "TWO"], "two.toml: cannot keep EEPROM here: "),
        (["--reality", "knob:nose:1"], "knob:nose:1: kind: 'nose' is not one of delay, strength"),
        (["--servos", "/nowhere.toml"], "/nowhere.toml: cannot be read"),
        (["--servos", "TWO", "--faults", "UNPLUG"], "unplugs a port; give --ports DIR"),
        (["--servos", "TWO", "--faults", "UNPLUG", "--ports", "/proc/none"], "cannot be made"),
        (["--servos", "TWO", "--injections", "/proc/none/x"], "/proc/none/x: cannot be written"),
    ],
)
def test_bad_arguments_are_one_line(two: str, tmp_path: Path, arguments: list[str], says: str) -> None:
    unplug = tmp_path / "unplug.toml"
    unplug.write_text('name = "x"\n[[event]]\nwhat = "unplugged"\nat = 2.0\nlasts = 1.0\n')
    words = [{"TWO": two, "UNPLUG": str(unplug)}.get(word, word) for word in arguments]
    done = subprocess.run([*COMMAND, *words], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert says in done.stderr


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('name = "x"\n', "servo: missing"),
        ('name = "x"\n[[servo]]\nmodel = "AX-12"\n', "servo[0].model: 'AX-12' is not one of"),
        (
            'name = "x"\n[[servo]]\nmodel = "XL330-M288-T"\nbaud = 4_500_000\n',
            "servo[0].baud: 4500000 is not one of 9600",
        ),
        ('name = "x"\n[[servo]]\nmodel = "XL330-M288-T"\nspeed = 1\n', "servo[0].speed: unknown"),
        ('name = "x"\n' + 2 * '[[servo]]\nmodel = "XL330-M288-T"\n', "servo[1].id: 1 at 57600 baud is another"),
    ],
)
def test_a_bad_servos_file_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(FileError, match=r"mine\.toml") as failure:
        load_servos(path)
    assert says in str(failure.value)


def test_two_emulators_do_not_share_a_folder_of_ports(two: str, tmp_path: Path) -> None:
    folder, truth = str(tmp_path / "folder"), tmp_path / "log.jsonl"
    words = ["--servos", two, "--ports", folder, "--injections", str(truth)]
    with emulator(*words) as (process, ready):
        with sdk(str(ready["servo_port"])) as (handler, packets):
            truth.write_text("of the first\n")
            second = subprocess.run([*COMMAND, *words], capture_output=True, text=True, check=False, timeout=60)
            assert (second.returncode, second.stdout) == (2, "")
            assert second.stderr == f"robolamp: {folder}: another robolamp is at work here\n"
            assert truth.read_text() == "of the first\n"
            assert packets.ping(handler, 5)[1] == COMM_SUCCESS  # the first goes on
        process.kill()
        process.wait(timeout=10)
    assert (tmp_path / "folder" / "servo").is_symlink()  # it was killed: its link is left
    with emulator(*words) as (process, ready), sdk(str(ready["servo_port"])) as (handler, packets):
        assert packets.ping(handler, 5)[1] == COMM_SUCCESS
