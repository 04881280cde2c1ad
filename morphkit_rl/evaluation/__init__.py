"""What a policy is worth: episodes without noise, compared with a random policy."""
