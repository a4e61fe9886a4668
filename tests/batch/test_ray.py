"""Items done by the nodes of a Ray cluster; skipped where the extra `ray` is not installed (`make ray`)."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from tests.app.test_fleet import read_contents, write_small_fleet
from tests.batch.fake_work import Fake, fake_work, make_item, read_results

from skyproof.app.fleet import fleet
from skyproof.batch import Processes, Store, run
from skyproof.errors import SettingsError

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.long


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Start the first node of a cluster; tests add others."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    made = pytest.importorskip("ray.cluster_utils").Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    yield made
    ray.shutdown()
    made.shutdown()


@contextmanager
def remove_node(cluster: Any, out: Path, after: int) -> Iterator[list[int]]:
    """Kill a node once so many items are done, while the block lasts. Return how many were done then."""
    node, at = cluster.add_node(num_cpus=1), list[int]()
    cluster.add_node(num_cpus=1)

    def remove() -> None:
        while (count := len(list((out / ".skyproof-batch" / "done").glob("*")))) < after:
            time.sleep(0.05)
        cluster.remove_node(node, allow_graceful=False)  # raises if a process of it is left
        at.append(count)

    remover = threading.Thread(target=remove, daemon=True)
    remover.start()
    yield at
    remover.join(60.0)


def run_items(folder: Path, fakes: list[Fake], runner: Any) -> dict[str, str]:
    with Store(folder) as store, runner as doing:
        errors, remaining = run([make_item(fake) for fake in fakes], fake_work, store, doing)
    assert not remaining
    return errors


def test_a_node_and_a_worker_that_die_leave_the_same_bytes(tmp_path: Path, cluster: Any) -> None:
    (tmp_path / "kills").mkdir()
    fakes = [Fake(n, sleep_s=0.2) for n in range(40)]
    fakes += [Fake(40, error=True), Fake(41, kills=str(tmp_path / "kills"), how_often=1)]
    with remove_node(cluster, tmp_path / "ray", 8) as removed:
        errors = run_items(tmp_path / "ray", fakes, import_module("skyproof.batch.ray_nodes").RayNodes(cluster.address))
    assert removed[0] < 30
    assert len(list((tmp_path / "kills").iterdir())) == 1
    assert [(key, words.partition(":")[0]) for key, words in errors.items()] == [("item-40", "item 40")]
    assert run_items(tmp_path / "processes", fakes, Processes(2)) == errors
    assert read_results(tmp_path / "ray") == read_results(tmp_path / "processes")
    assert len(read_results(tmp_path / "ray")) == 2 * 41


def test_a_cluster_that_loses_a_node_gives_the_same_bytes(tmp_path: Path, cluster: Any) -> None:
    path = write_small_fleet(tmp_path / "in", 8)
    with remove_node(cluster, tmp_path / "ray", 2) as removed:
        result = fleet(path, out=tmp_path / "ray", ray=cluster.address)
    assert removed[0] < 6
    assert sum(row.state == "done" for row in result.rows) == 8
    fleet(path, out=tmp_path / "processes", workers=1)
    assert read_contents(tmp_path / "ray") == read_contents(tmp_path / "processes")


def test_an_address_without_a_cluster_is_an_error_with_advice(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"'127\.0\.0\.1:1'"):
        import_module("skyproof.batch.ray_nodes").RayNodes("127.0.0.1:1").__enter__()
