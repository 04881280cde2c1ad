"""Kernels of what an update does besides networks, against PyTorch."""

from __future__ import annotations

from copy import deepcopy

import pytest
import torch
from torch import Tensor, nn

from morphkit_rl.algorithms.critic_losses import CrossEntropy
from morphkit_rl.kernels import categorical
from morphkit_rl.kernels.adam import AdamStep
from morphkit_rl.kernels.gradient_rows import GradientRows
from tests.support.kernels import compiled

pytestmark = [compiled, pytest.mark.usefixtures("precision", "threads")]
SIZES = ((7, 3), (5000,), (1,), (2, 64, 64))


@pytest.mark.parametrize("clip", [0.0, 0.5, 1e6])
def test_adam_does_what_pytorch_does(clip: float) -> None:
    torch.manual_seed(0)
    own = [nn.Parameter(torch.randn(size)) for size in SIZES]
    other = deepcopy(own)
    rows = GradientRows([*own, torch.empty(3)])
    averages = [[p.detach().clone() for p in own] for _ in range(2)]
    followed = deepcopy(averages)
    ours, theirs = (torch.optim.Adam(parameters, 1e-2, betas=(0.8, 0.99)) for parameters in (own, other))
    for number in range(6):
        gradients = [torch.randn_like(p) * 10.0 ** (number - 3) for p in own]
        gradients[2].zero_()
        for parameter, gradient in zip(other, gradients, strict=True):
            parameter.grad = gradient.clone()
        if clip:
            nn.utils.clip_grad_norm_(other, clip)
        theirs.step()
        shares = (0.1, 0.75) if number % 2 else ()
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        for thread, row in enumerate(rows.rows):
            share = 0.5 ** min(thread + 1, len(rows.rows) - 1)  # such as 1/2, 1/4, 1/4, so that their sum is exact
            row[:] = torch.cat([share * flat, torch.tensor([1.0, 2.0, 3.0])])
        AdamStep(ours, own, rows, clip, list(zip(averages, shares, strict=False)))()
        assert rows.rows.count_nonzero() == 3 * len(rows.rows), "what is no parameter's is left as it was"
        for share, tensors in zip(shares, followed, strict=False):
            torch._foreach_lerp_(tensors, other, share)
    assert_close = torch.testing.assert_close
    assert_close([p.detach() for p in own], [p.detach() for p in other], rtol=1e-5, atol=1e-6)
    assert_close(averages, [[t.detach() for t in tensors] for tensors in followed], rtol=1e-5, atol=1e-6)
    for a, b in zip(own, other, strict=True):
        assert_close(dict(ours.state[a]), dict(theirs.state[b]), rtol=1e-4, atol=1e-9)


def test_adam_goes_on_from_what_pytorch_saved() -> None:
    torch.manual_seed(0)
    own, other = (nn.Parameter(torch.arange(5.0)) for _ in range(2))
    ours, theirs = (torch.optim.Adam([p], 1e-2, fused=True) for p in (own, other))
    other.grad = torch.ones(5)
    theirs.step()
    own.data.copy_(other.data)
    ours.load_state_dict(theirs.state_dict())
    theirs.step()
    rows = GradientRows([own])
    step = AdamStep(ours, [own], rows, 0.0)
    rows.part(own)[:] = 1
    step()
    torch.testing.assert_close(own.detach(), other.detach())
    assert step.is_current
    ours.load_state_dict(theirs.state_dict())
    assert not step.is_current, "its moments lie elsewhere now"


def test_rates_are_those_of_the_optimizer_at_each_step() -> None:
    parameter = nn.Parameter(torch.zeros(4))
    optimizer, rows = torch.optim.Adam([parameter], 1e-2), GradientRows([parameter])
    step = AdamStep(optimizer, [parameter], rows, 0.0)
    for rate in (1e-2, 0.5):
        optimizer.param_groups[0]["lr"] = rate
        before = parameter.detach().clone()
        rows.part(parameter)[:] = 1
        step()
        torch.testing.assert_close(before - parameter.detach(), torch.full((4,), rate), rtol=1e-4, atol=0)


def test_rows_of_gradients_are_told_apart_by_thread_and_tensor() -> None:
    first, second, third = tensors = torch.empty(2, 3), torch.empty(5), torch.empty(1)
    rows = GradientRows(tensors)
    threads = len(rows.rows)
    assert threads == torch.get_num_threads()
    places = [(place - rows.rows.data_ptr()) // 4 for place in rows.pointers([third, first])]
    assert places == [place + 12 * thread for thread in range(threads) for place in (11, 0)]
    rows.rows[:] = torch.arange(12.0)
    assert torch.equal(rows.part(second), torch.arange(6.0, 11.0))
    assert torch.equal(rows.take(first), threads * torch.arange(6.0).view(2, 3))
    assert rows.rows[:, :6].count_nonzero() == 0
    assert torch.equal(rows.part(third), torch.tensor([11.0]))


@pytest.mark.parametrize(("batch", "robots", "atoms", "support"), [(9, 3, 101, 5.0), (1, 1, 2, 0.5), (4, 2, 16, 20.0)])
def test_errors_of_categorical_values(batch: int, robots: int, atoms: int, support: float) -> None:
    torch.manual_seed(0)
    loss = CrossEntropy(atoms, support)
    logits, next_logits = (3 * torch.randn(2, batch, robots, atoms) for _ in range(2))
    next_logits[0, 0, 0, 0] = 60.0  # as good as certain
    reward, discount = support * torch.randn(batch, robots), torch.rand(batch, robots).round(decimals=1)
    scale, weight, value_weight = torch.rand(3, robots)
    exact = logits.double().requires_grad_()
    loss.values = loss.values.double()
    target = loss.target(next_logits.double(), reward.double() * scale, discount.double())
    expected = (loss.error(exact, target) * weight).sum()
    gradient = torch.empty_like(logits)
    found_error, found_value = categorical.categorical_error(
        logits, next_logits, reward, discount, support,
        reward_scale=scale, weight=weight, value_weight=value_weight, gradient=gradient,
    )  # fmt: skip
    value = (loss.expectation(exact).mean(0) * value_weight).sum()
    assert found_error.item() == pytest.approx(expected.item(), rel=1e-5)
    assert found_value.item() == pytest.approx(value.item(), rel=1e-4, abs=1e-5)
    assert_near(gradient, *torch.autograd.grad(expected, exact))


@pytest.mark.parametrize("members", [1, 2])
def test_values_of_categorical_values(members: int) -> None:
    torch.manual_seed(0)
    loss, weight = CrossEntropy(33, 2.0), torch.tensor([0.5, -2.0])
    loss.values = loss.values.double()
    logits = 3 * torch.randn(members, 5, 2, 33)
    exact = logits.double().requires_grad_()
    expected = (loss.expectation(exact).mean(0) * weight).sum()
    gradient = torch.empty_like(logits)
    value = categorical.categorical_value(logits, 2.0, weight, gradient)
    assert value.item() == pytest.approx(expected.item(), rel=1e-5)
    assert_near(gradient, *torch.autograd.grad(expected, exact))


def assert_near(found: Tensor, exact: Tensor) -> None:
    assert (found - exact).norm() <= 1e-5 * exact.norm()
