"""Networks: attention is over space, layers hand on their state and share a head, phases freeze the rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from dohyo.agents.forecasting.data.scale import Scale
from dohyo.agents.forecasting.data.windows import make_windows
from dohyo.agents.forecasting.networks.attention import TransformerTrunk
from dohyo.agents.forecasting.networks.convolution import SaConvLstmTrunk
from dohyo.agents.forecasting.networks.looking_ahead import NStep, Recursive, SpeedNetwork
from dohyo.agents.forecasting.networks.lstm import LstmTrunk, SaLstmTrunk, SpatialAttention, units_for
from dohyo.agents.forecasting.networks.registry import NETWORKS, make_network
from dohyo.agents.forecasting.training import TrainSettings, train_network
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from tests.agents.forecasting.roads import road_stretch

N = 6


def randomised(network: torch.nn.Module, seed: int = 0) -> torch.nn.Module:
    """Heads start from zero; tests want them to say something."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(0.5 * torch.randn(parameter.shape, generator=generator))
    return network.eval()


def test_attention_is_among_segments_and_follows_their_order() -> None:
    attention = randomised(SpatialAttention(3))
    tokens, order = torch.randn(2, N, 3), torch.tensor([3, 0, 5, 1, 4, 2])
    torch.testing.assert_close(attention(tokens[:, order]), attention(tokens)[:, order])
    elsewhere = tokens.clone()
    elsewhere[:, 5] += 1.0
    assert (attention(elsewhere)[:, 0] != attention(tokens)[:, 0]).all(), "a far segment reaches the first one"


def test_attention_of_two_tokens_by_hand() -> None:
    attention = SpatialAttention(1, attention_width=1)
    with torch.no_grad():
        for parameter, value in ((attention.query, 2.0), (attention.key, 1.0), (attention.value, 10.0)):
            parameter.fill_(value)
    first, second = 1.0, -1.0
    share = np.exp(2.0 * first * first) / (np.exp(2.0 * first * first) + np.exp(2.0 * first * second))
    expected = first + 10.0 * (share * first + (1 - share) * second)
    got = attention(torch.tensor([[[first], [second]]]))
    assert float(got[0, 0, 0].detach()) == pytest.approx(expected, rel=1e-5)


def sa_lstm_by_the_formula(trunk: SaLstmTrunk, history: Tensor) -> Tensor:
    """Row by row, gate by gate, as the thesis writes it."""
    size = trunk.features
    h, c = torch.zeros(len(history), size), torch.zeros(len(history), size)
    for row in history.unbind(1):
        gates = torch.cat([row, h, torch.ones(len(row), 1)], 1) @ trunk.weight
        enter, forget, cell, output = gates.chunk(4, 1)
        tokens = output.view(-1, trunk.segments, trunk.units)
        query, key = tokens @ trunk.attention.query, tokens @ trunk.attention.key
        weights = torch.softmax(query @ key.transpose(1, 2) / query.shape[2] ** 0.5, dim=-1)
        tokens = tokens + weights @ (tokens @ trunk.attention.value)
        c = forget.sigmoid() * c + enter.sigmoid() * cell.tanh()
        h = tokens.view(-1, size).sigmoid() * c.tanh()
    return h


def test_an_sa_lstm_is_an_lstm_whose_output_gate_attends() -> None:
    trunk = randomised(SaLstmTrunk(N))
    assert isinstance(trunk, SaLstmTrunk)
    history = torch.randn(4, 8, N)
    torch.testing.assert_close(trunk(history)[0], sa_lstm_by_the_formula(trunk, history), rtol=1e-4, atol=1e-5)


def test_without_values_an_sa_lstm_is_an_lstm() -> None:
    attending, plain = randomised(SaLstmTrunk(N)), LstmTrunk(N)
    assert isinstance(attending, SaLstmTrunk)
    history = torch.randn(2, 8, N)
    with torch.no_grad():
        plain.weight.copy_(attending.weight)
        assert not torch.allclose(attending(history)[0], plain(history)[0])
        attending.attention.value.zero_()
    torch.testing.assert_close(attending(history)[0], plain(history)[0])


def test_an_lstm_equals_torchs_own() -> None:
    trunk = randomised(LstmTrunk(N))
    assert isinstance(trunk, LstmTrunk)
    theirs = torch.nn.LSTM(N, trunk.features, batch_first=True)
    with torch.no_grad():
        theirs.weight_ih_l0.copy_(trunk.weight[:N].T)
        theirs.weight_hh_l0.copy_(trunk.weight[N:-1].T)
        theirs.bias_ih_l0.copy_(trunk.weight[-1])
        theirs.bias_hh_l0.zero_()
    history = torch.randn(3, 8, N)
    torch.testing.assert_close(trunk(history)[0], theirs(history)[1][0][0], rtol=1e-4, atol=1e-5)


def test_a_state_carries_a_history_on() -> None:
    trunk = randomised(SaLstmTrunk(N))
    history = torch.randn(2, 8, N)
    _, state = trunk(history[:, :5])
    torch.testing.assert_close(trunk(history[:, 5:], state)[0], trunk(history)[0])


class Spy(torch.nn.Module):
    """Says what it was given, and hands on a state of its own."""

    features = 4

    def __init__(self, seen: list[tuple[int, object]]) -> None:
        super().__init__()
        self.seen = seen

    def forward(self, history: Tensor, state: object = None) -> tuple[Tensor, object]:
        self.seen.append((history.shape[1], state))
        number = len(self.seen)
        return torch.full((len(history), self.features), float(number)), f"state {number}"


def test_n_step_layers_read_one_row_more_each_and_start_from_the_state_before() -> None:
    seen: list[tuple[int, object]] = []
    network = NStep(lambda _: Spy(seen), N)
    network(torch.randn(1, 8, N))
    assert seen == [(8, None), (9, "state 1"), (10, "state 2")]


def test_a_later_layer_sees_the_forecasts_of_the_earlier_ones() -> None:
    network = randomised(NStep(SaLstmTrunk, N))
    assert isinstance(network, NStep)
    read: list[Tensor] = []
    network.layers[2].register_forward_pre_hook(lambda _, inputs: read.append(inputs[0]))
    history = torch.randn(1, 8, N)
    ahead = network(history)
    torch.testing.assert_close(read[0][:, :8], history)
    torch.testing.assert_close(read[0][:, 8:], ahead[:, :2])


def test_all_layers_share_one_head() -> None:
    network = randomised(NStep(SaLstmTrunk, N))
    history = torch.randn(1, 8, N)
    before = network(history)
    with torch.no_grad():
        network.head.bias += 1.0  # type: ignore[union-attr, operator]
    change = (network(history) - before)[0, :, 0].detach()
    assert float(change[0]) == pytest.approx(1.0, abs=1e-5)
    assert (change[1:] != 0.0).all()
    assert sum(isinstance(module, torch.nn.Linear) for module in network.modules()) == 1


def test_recursive_forecasts_are_fed_back() -> None:
    network = randomised(Recursive(LstmTrunk, N))
    assert isinstance(network, Recursive)
    history = torch.randn(1, 8, N)
    first = network.step(history)
    second = network.step(torch.cat([history[:, 1:], first], 1))
    torch.testing.assert_close(network(history)[:, :2], torch.cat([first, second], 1))


@pytest.mark.parametrize("name", NETWORKS)
def test_an_untrained_network_is_persistence(name: str) -> None:
    history = torch.randn(2, 8, N)
    torch.testing.assert_close(make_network(name, N)(history), history[:, -1:].expand(-1, 3, -1))


@pytest.mark.parametrize("name", NETWORKS)
def test_the_first_rows_are_the_same_however_many_are_asked_for(name: str) -> None:
    network = randomised(make_network(name, N)).double()  # large random weights make much of a float's last digit
    assert isinstance(network, SpeedNetwork)
    history = torch.randn(3, 8, N, dtype=torch.float64)
    whole = network(history)
    assert whole.shape == (3, 3, N)
    torch.testing.assert_close(network.ahead(history, 1), whole[:, :1])
    torch.testing.assert_close(torch.cat([network(one[None]) for one in history]), whole)


def test_a_transformers_tokens_are_minutes_and_an_sa_convlstms_segments() -> None:
    history = torch.randn(1, 8, N)
    earlier = history.clone()
    earlier[:, 0] += 1.0
    transformer = randomised(TransformerTrunk(N))
    assert not torch.allclose(transformer(history)[0], transformer(earlier)[0])
    elsewhere = history.clone()
    elsewhere[:, -1, -1] += 1.0  # the last row reaches the first segment at once, which no convolution of width 3 does
    conv = randomised(SaConvLstmTrunk(N))
    first = conv(history)[0].view(-1, N)[:, 0], conv(elsewhere)[0].view(-1, N)[:, 0]
    assert not torch.allclose(*first)


def module_of(parameter: str) -> str:
    """layers.0 of layers.0.attention.query, head of head.bias."""
    return ".".join(parameter.split(".")[: 2 if parameter.startswith("layers") else 1])


def test_each_phase_changes_what_it_names_and_nothing_else() -> None:
    network = make_network("sa-lstm-n-step", N)
    train = make_windows([road_stretch(60, N, 0)], 60.0)
    after: list[dict[str, Tensor]] = [{k: v.clone() for k, v in network.state_dict().items()}]
    real_phases = network.phases()
    settings, scale = TrainSettings(steps=3, validate_every=1, batch=16, depth=1), Scale.of(train)
    for number in range(4):
        network.phases = lambda upto=number: real_phases[: upto + 1]  # type: ignore[method-assign, misc]
        train_network(network, train, train, scale, 31.0, settings, first=number)
        after.append({k: v.clone() for k, v in network.state_dict().items()})
    changed = [{module_of(name) for name in old if not old[name].equal(new[name])} for old, new in pairwise(after)]
    assert changed == [{"layers.0", "head"}, {"layers.1"}, {"layers.2"}, {"layers.0", "layers.1", "layers.2", "head"}]


def test_roads_with_many_segments_have_fewer_units_each() -> None:
    assert [units_for(n) for n in (1, 21, 85, 128, 200, 1000)] == [3, 3, 3, 2, 1, 1]


def test_an_unknown_network_is_named() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'sa-lstm'"):
        make_network("sa-lst", N)


@pytest.mark.parametrize("wrong", [{"depth": 5}, {"depth": -1}, {"rate": 0.0}, {"steps": 0}, {"batch": -1}])
def test_impossible_settings_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(InvalidInputError, match="expected"):
        TrainSettings(**wrong)  # type: ignore[arg-type]
