"""`morphkit push`: a policy onto the Hugging Face hub."""

from __future__ import annotations

from typing import Annotated

import typer

from . import common
from .terminal import write

EXAMPLES = (
    "morphkit push runs/first my-name/cheetahs",
    "morphkit push runs/first my-name/cheetahs --private --checkpoint best",
)


def push(
    run: common.PolicyArgument,
    repository: Annotated[str, typer.Argument(metavar="OWNER/NAME", help="Repository on the hub.")],
    private: Annotated[bool, typer.Option("--private", help="Make a new repository private.")] = False,
    checkpoint: common.CheckpointOption = "latest",
) -> None:
    """Upload a policy to the Hugging Face hub, with a model card.

    Actor, observation statistics, settings and the bodies' files go there; critics, replay and paths of this machine do
    not. Log in before with: hf auth login. Policy.from_hub("OWNER/NAME") loads it.
    """
    from morphkit_rl.evaluation.model_card import push_texts
    from morphkit_rl.runs import hub, saved_policy

    policy = saved_policy.load(run, checkpoint)
    write(hub.push(policy, repository, push_texts(policy, repository), private=private) + "\n")
