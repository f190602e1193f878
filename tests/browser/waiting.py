"""Waiting for what a page does."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page


def until(page: Page, expression: str) -> None:
    """Wait for an expression (the page's policy forbids it the eval that wait_for_function needs)."""
    for _ in range(250):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(20)
    raise AssertionError(f"never became true: {expression}")
