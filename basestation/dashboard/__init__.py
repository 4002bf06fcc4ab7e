"""The page: shows the fleet in a browser, and takes orders from it. A process of its own beside the base station's."""
