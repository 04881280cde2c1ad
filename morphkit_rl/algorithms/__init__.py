"""TD3 over many morphologies, and what acts and learns with it."""
