"""Derivatives of an answer by the numbers, loads and motions of its scene."""
