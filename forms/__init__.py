"""What things obey: solids, the contact term and the friction law."""

if __name__ == "forms":  # beside tribox.forms it would hold everything a second time
    raise ImportError("forms is imported as tribox.forms: put src on the path")
