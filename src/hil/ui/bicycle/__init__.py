"""The page of a bicycle's ride: an animation, the text's plots, and the numbers behind them."""

from hil.ui.bicycle.page import ride_page

__all__ = ["ride_page"]
