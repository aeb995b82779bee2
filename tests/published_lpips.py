#!/usr/bin/env python3
"""What the published LPIPS says of the pictures that the tests of ours compare.

published_lpips.py [WEIGHTS]

Needs the PyPI packages lpips, torch and torchvision, and safetensors for WEIGHTS: a folder that holds
lpips_alexnet.safetensors and lpips_vgg16.safetensors with the names that `dash eval --lpips-alex` and `--lpips-vgg` take.
Without it the networks have the tests' generated weights. The values stand in dash-train/src/metrics/lpips/tests/published.rs.
"""
import sys

import lpips
import numpy as np
import torch

SIZES = [(67, 75), (64, 33)]  # width, height


def hashed(seed, n):
    """Uniform in [0, 1), exactly as in the tests."""
    x = np.arange(n, dtype=np.uint32) * np.uint32(2654435761) + np.uint32(seed * 40503 % 2**32)
    for shift, factor in [(16, 2246822519), (13, 3266489917)]:
        x = (x ^ (x >> np.uint32(shift))) * np.uint32(factor)
    x ^= x >> np.uint32(16)
    return (x >> np.uint32(8)).astype(np.float64) / 2**24


def picture(seed, width, height):
    ramp = np.arange(width * height * 3) // 3 % width / width
    values = 0.6 * ramp + 0.4 * hashed(seed, width * height * 3)
    return torch.tensor(values.reshape(1, height, width, 3).transpose(0, 3, 1, 2), dtype=torch.float32)


def parameters(model):
    """Name as torchvision and LPIPS have it, and parameter, in the order of the layers."""
    for name, parameter in model.net.named_parameters():
        _, index, kind = name.split(".")
        yield f"features.{index}.{kind}", parameter
    for i, lin in enumerate([model.lin0, model.lin1, model.lin2, model.lin3, model.lin4]):
        yield f"lin{i}.model.1.weight", lin.model[1].weight


def generated(name, shape, seed):
    values = hashed(seed, int(np.prod(shape)))
    if name.startswith("features"):
        bound = np.sqrt(6 / np.prod(shape[1:]))
        values = bound * (2 * values - 1) if len(shape) > 1 else 0.1 * (values - 0.5)
    return values.reshape(shape)


for net, file in [("alex", "alexnet"), ("vgg", "vgg16")]:
    model = lpips.LPIPS(net=net, pretrained=False, pnet_rand=True, verbose=False).eval()
    own = None
    if len(sys.argv) > 1:
        from safetensors.numpy import load_file

        own = load_file(f"{sys.argv[1]}/lpips_{file}.safetensors")
    with torch.no_grad():
        for at, (name, parameter) in enumerate(parameters(model)):
            values = own[name] if own else generated(name, tuple(parameter.shape), 300 + at)
            parameter.copy_(torch.tensor(values))
        model.double()
        for width, height in SIZES:
            a, b = (picture(seed, width, height).double() for seed in (1, 2))
            print(net, width, height, f"{model(a, b, normalize=True).item():.7f}")
