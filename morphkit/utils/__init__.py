"""What every part of morphkit needs: staged output, worker processes, file writing, caches, suggestions."""
