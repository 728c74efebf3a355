"""Scenes as text."""

import yaml


def through_yaml(content):
    """Return content as it is read from its YAML, which the library in C does in a tenth of the time."""
    text = yaml.dump(content, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper))
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
