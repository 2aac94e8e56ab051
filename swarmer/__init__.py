"""swarmer: run decentralized localization of Flying Light Specks (SwarMer, arXiv 2312.04571)."""

__version__ = "0.1.0"
