"""Policies that leave the project: one robot's actor, normalizer and names as one ONNX or TorchScript file."""
