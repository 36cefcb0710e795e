"""The lubricating film as an unknown: rough surfaces at a mean gap, and the oil between them."""
