"""What a policy is worth: episodes without noise, beside a random policy."""
