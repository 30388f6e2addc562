from __future__ import annotations

import importlib.util

import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.errors import TrackfgError
from trackfg.peers import installed, python_ins, vqf_offline
from trackfg.peers.installed import NotInstalledError, is_installed, require


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "find_spec", lambda _: None)


def test_is_installed_says_what_can_be_imported() -> None:
    assert is_installed("vqf") == (importlib.util.find_spec("vqf") is not None)
    assert is_installed("python-ins") == (importlib.util.find_spec("pyins") is not None)


@pytest.mark.usefixtures("nothing_installed")
@pytest.mark.parametrize("peer", ["python-ins", "vqf"])
def test_error_names_the_extra(peer: installed.Peer) -> None:
    assert not is_installed(peer)
    with pytest.raises(NotInstalledError, match=rf'{peer} is not installed.*pip install "trackfg\[peers\]"') as raised:
        require(peer)
    assert isinstance(raised.value, TrackfgError)


@pytest.mark.usefixtures("nothing_installed")
@pytest.mark.parametrize("run", [python_ins.run, vqf_offline.run])
def test_a_peer_that_is_not_installed_says_so(run: object) -> None:
    assert callable(run)
    with pytest.raises(NotInstalledError):
        run(simulate("trolley", duration_s=20.0).recording)
