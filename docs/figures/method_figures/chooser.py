def render_chooser():
    return ""
