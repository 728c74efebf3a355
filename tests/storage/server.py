"""An object store for the tests: SeaweedFS on free ports of the loopback interface."""

import json
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path

KEYS = {"writer": ("writerkey", "writersecret"), "stranger": ("strangerkey", "strangersecret")}
"""Access keys: one for everything, one for another bucket only."""

_PORTS = ("master.port", "master.port.grpc", "volume.port", "volume.port.grpc")
_PORTS += ("filer.port", "filer.port.grpc", "s3.port", "s3.port.grpc")
_OPTIONS = ("-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-master.peers=none", "-master.telemetry=false")
_OPTIONS += ("-master.volumeSizeLimitMB=64", "-volume.max=20", "-filer", "-s3", "-s3.autoCreateBucket=false")
_OPTIONS += ("-s3.port.iceberg=0", "-s3.port.lance=0")


def program() -> str | None:
    """Return the path of the server; None if it is not installed."""
    beside = Path(sys.executable).with_name("weed")
    return str(beside) if beside.exists() else shutil.which("weed")


class Server:
    """A running server with the buckets ``trial`` and, for everyone to read, ``public``; its data are in a folder."""

    def __init__(self, folder: Path) -> None:
        ports = dict(zip(_PORTS, _free_ports(len(_PORTS)), strict=True))
        self.port, self._filer = ports["s3.port"], ports["filer.port"]
        identities = [_identity(name, ["Admin"] if name == "writer" else ["Read:other"]) for name in KEYS]
        identities.append({"name": "anonymous", "actions": ["Read:public", "List:public"]})
        (folder / "s3.json").write_text(json.dumps({"identities": identities}))
        (folder / "data").mkdir()
        options = [f"-{name}={port}" for name, port in ports.items()]
        command = [program(), "-logtostderr", "server", "-dir=data", "-s3.config=s3.json", *_OPTIONS, *options]
        with (folder / "log").open("wb") as log:
            self._process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)
        self._ports = ports.values()
        while self._process.poll() is None:
            if self._is_up():
                return
            time.sleep(0.1)
        self.kill()
        raise RuntimeError((folder / "log").read_text()[-2000:])

    def _is_up(self) -> bool:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{self.port}/status", timeout=5)
            for bucket in ("trial", "public"):  # the server's file system makes the buckets
                url = f"http://127.0.0.1:{self._filer}/buckets/{bucket}/"
                urllib.request.urlopen(urllib.request.Request(url, method="POST"), timeout=5)
        except OSError:
            return False
        return True

    def kill(self) -> None:
        """End the server; a request to end would take it seconds."""
        self._process.kill()
        self._process.wait()
        for port in self._ports:
            for left in Path("/tmp").glob(f"seaweedfs-*-{port}.sock"):
                left.unlink(missing_ok=True)


def _identity(name, actions):
    access, secret = KEYS[name]
    return {"name": name, "credentials": [{"accessKey": access, "secretKey": secret}], "actions": actions}


def _free_ports(number):
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(number)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
