"""Learned networks in torch: their layers, files of weights, and ONNX made of them."""
