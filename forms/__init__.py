"""What things obey: solids, the contact term and the friction law."""
