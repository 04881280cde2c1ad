"""Kernels of what an update does besides networks, against PyTorch."""

from __future__ import annotations

from copy import deepcopy

import pytest
import torch
from torch import Tensor, nn

from morphkit_rl.algorithms.critic_losses import CrossEntropy
from morphkit_rl.kernels import adam, categorical
from morphkit_rl.kernels.call import Call
from tests.support.kernels import compiled

pytestmark = [compiled, pytest.mark.usefixtures("precision", "threads")]
SIZES = ((7, 3), (5000,), (1,), (2, 64, 64))


@pytest.mark.parametrize("clip", [0.0, 0.5, 1e6])
def test_adam_does_what_pytorch_does(clip: float) -> None:
    torch.manual_seed(0)
    own = [nn.Parameter(torch.randn(size)) for size in SIZES]
    other = deepcopy(own)
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
        adam.adam_step(ours, own, gradients, clip, list(zip(averages, shares, strict=False)))
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
    adam.adam_step(ours, [own], [torch.ones(5)], 0.0)
    torch.testing.assert_close(own.detach(), other.detach())


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
    found = categorical.categorical_error(
        logits, next_logits, reward, discount, support, reward_scale=scale, weight=weight, value_weight=value_weight
    )
    value = (loss.expectation(exact).mean(0) * value_weight).sum()
    assert found.error.item() == pytest.approx(expected.item(), rel=1e-5)
    assert found.value.item() == pytest.approx(value.item(), rel=1e-4, abs=1e-5)
    assert_near(found.gradient, *torch.autograd.grad(expected, exact))


@pytest.mark.parametrize("members", [1, 2])
def test_values_of_categorical_values(members: int) -> None:
    torch.manual_seed(0)
    loss, weight = CrossEntropy(33, 2.0), torch.tensor([0.5, -2.0])
    loss.values = loss.values.double()
    logits = 3 * torch.randn(members, 5, 2, 33)
    exact = logits.double().requires_grad_()
    expected = (loss.expectation(exact).mean(0) * weight).sum()
    value, gradient = categorical.categorical_value(logits, 2.0, weight)
    assert value.item() == pytest.approx(expected.item(), rel=1e-5)
    assert_near(gradient, *torch.autograd.grad(expected, exact))


def test_a_call_is_a_function_without_autograd() -> None:
    class Scaled(torch.autograd.Function):
        @staticmethod
        def forward(ctx, x: Tensor, factor: Tensor) -> Tensor:
            ctx.save_for_backward(x, factor)
            return x * factor

        @staticmethod
        def backward(ctx, gradient: Tensor) -> tuple[Tensor | None, ...]:
            x, factor = ctx.saved_tensors
            return tuple(
                gradient * other if wanted else None
                for other, wanted in zip((factor, x), ctx.needs_input_grad, strict=True)
            )

    call = Call(Scaled, torch.tensor(2.0), torch.tensor(3.0), wanted=(True, False))
    assert call.output == 6
    assert call.backward(torch.tensor(10.0)) == (30, None)


def assert_near(found: Tensor, exact: Tensor) -> None:
    assert (found - exact).norm() <= 1e-5 * exact.norm()
