"""The use cases of `use_cases` in place of our own."""

from collections.abc import Iterator

import pytest
from tests.cli.use_cases import App

from skyproof.cli import inspect as inspect_command
from skyproof.cli import study as study_command


@pytest.fixture
def app(monkeypatch: pytest.MonkeyPatch) -> Iterator[App]:
    fake = App()
    for name in ("protect", "receive", "demo", "simulate"):
        monkeypatch.setattr(
            f"skyproof.app.{name}.{name}", lambda inputs, _name=name, **options: fake.run(_name, inputs, options)
        )
    monkeypatch.setattr("skyproof.app.init.init", fake.init)
    monkeypatch.setattr("skyproof.app.verify.verify", fake.verify)
    monkeypatch.setattr("skyproof.app.fleet.fleet", fake.fleet)
    monkeypatch.setattr(inspect_command, "run_inspect", fake.inspect)
    monkeypatch.setattr(study_command, "studies", fake.make_studies)
    return fake
