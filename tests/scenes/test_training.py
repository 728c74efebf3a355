"""Training learns and is reproducible, and the exported model gives the results of the network; scores by hand."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.scenes import TrainingParams
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.training import Examples, SceneScores, check_torch, train
from tests.scenes.walls import toy_cloud


@pytest.fixture
def torch():
    pytest.importorskip("onnx", reason="needs the extra train")
    return pytest.importorskip("torch", reason="needs the extra train")


def toys(recordings, frames=1):
    rng = np.random.default_rng(1)
    examples = Examples(("open", "confined"), 60.0)
    for number in range(recordings):
        examples.begin(str(number), number % 2)
        for _ in range(frames):
            examples.add(toy_cloud(number % 2, rng))
    return examples


def test_without_torch_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError) as caught:
        check_torch()
    assert str(caught.value) == "training requires an optional dependency: pip install 'seaclutter[train]'"


def test_the_shape_of_the_network(torch):
    from seaclutter_cli.scenes.network import make_network

    network = make_network(2).eval()
    maps = torch.zeros(1, 1, 224, 224)
    shapes = []
    for layer in network:
        maps = layer(maps)
        shapes.append(tuple(maps.shape[1:]))
    assert shapes[0] == (3, 112, 112)
    assert (64, 7, 7) in shapes
    assert shapes[-3:] == [(64, 1, 1), (64,), (2,)]
    assert any(type(layer).__name__ == "Residual" for layer in network)
    depthwise = [m for m in network.modules() if isinstance(m, torch.nn.Conv2d) and m.groups == m.in_channels > 1]
    assert len(depthwise) == 8


def test_the_exported_model_gives_the_results_of_the_network(torch, tmp_path):
    pytest.importorskip("onnxruntime", reason="needs the extra scene")
    from seaclutter_cli.scenes.network import make_network, to_onnx

    torch.manual_seed(1)
    network = make_network(3)
    rng = np.random.default_rng(1)
    images = (rng.random((16, 1, 224, 224)) < rng.uniform(0, 0.2, (16, 1, 1, 1))).astype(np.uint8)
    with torch.no_grad():
        for _ in range(3):
            network.train()(torch.from_numpy(images).float())  # statistics other than the initial ones
        expected = torch.softmax(network.eval()(torch.from_numpy(images).float()), 1).numpy()
    data = to_onnx(network, ("a", "b", "c"), 42.5)
    assert data == to_onnx(network, ("a", "b", "c"), 42.5)
    assert len(data) < 1e6
    (tmp_path / "m.onnx").write_bytes(data)
    model = SceneModel(str(tmp_path / "m.onnx"))
    assert (model.classes, model.extent_m) == (("a", "b", "c"), 42.5)
    found = np.stack([model.probabilities(image[0]) for image in images])
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert expected.max(axis=1).std() > 0


def test_training_is_reproducible(torch):
    params = TrainingParams(epochs=2, batch=4, seed=3)
    first, second = (train(toys(10), params) for _ in range(2))
    assert first.epochs == second.epochs
    assert first.test.counts.tolist() == second.test.counts.tolist()
    weights = zip(first.network.state_dict().values(), second.network.state_dict().values(), strict=True)
    assert all(torch.equal(one, other) for one, other in weights)


def test_the_best_epoch_is_kept(torch):
    reported = []
    trained = train(toys(10), TrainingParams(epochs=3, batch=4), reported.append)
    assert reported == list(trained.epochs)
    assert trained.epochs[trained.best].validation_loss == min(epoch.validation_loss for epoch in reported)
    assert trained.test.counts.sum() == len(trained.split.test)


@pytest.mark.slow
def test_it_learns(torch):
    trained = train(toys(80), TrainingParams(epochs=25, batch=8))
    assert trained.test.accuracy == 1


CLASSES = ("open", "confined", "ice")


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=50))
def test_counts_and_shares(pairs):
    truth, predicted = np.array(pairs, np.int64).reshape(-1, 2).T
    found = SceneScores.count(CLASSES, truth, predicted)
    for kind in range(3):
        truths = [t for t, p in pairs if p == kind]
        predictions = [p for t, p in pairs if t == kind]
        precision = truths.count(kind) / len(truths) if truths else np.nan
        recall = predictions.count(kind) / len(predictions) if predictions else np.nan
        np.testing.assert_allclose((found.precision[kind], found.recall[kind]), (precision, recall))
    correct = sum(t == p for t, p in pairs)
    np.testing.assert_allclose(found.accuracy, correct / len(pairs) if pairs else np.nan)
    assert found.counts.sum() == len(pairs)


def test_as_json():
    found = SceneScores.count(CLASSES, np.array([0, 0, 1]), np.array([0, 1, 1]))
    counts = {"open": 1, "confined": 1, "ice": 0}
    assert found.as_dict()["open"] == {"predicted": counts, "precision": 1.0, "recall": 0.5}
    assert found.as_dict()["ice"]["precision"] is None
    assert found.mean_precision == 0.5
