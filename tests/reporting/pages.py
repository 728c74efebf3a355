"""Report pages that are open in a browser."""

PIXEL_COUNTS = """canvas => {
  const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const counts = new Map();
  for (let i = 0; i < data.length; i += 4) {
    const color = "#" + [0, 1, 2].map(k => data[i + k].toString(16).padStart(2, "0")).join("");
    counts.set(color, (counts.get(color) || 0) + 1);
  }
  return Object.fromEntries(counts);
}"""

SMALL_CONTROLS = """[...document.querySelectorAll('button, select')].filter(one =>
  one.offsetParent && (one.offsetHeight < 24 || one.offsetWidth < 24)).length"""  # WCAG 2.2, 2.5.8


class Visit:
    """An open page, with its console messages, requests and dialogs."""

    def __init__(self, browser, path, width=1200, height=900, **settings):
        self.context = browser.new_context(viewport={"width": width, "height": height}, offline=True, **settings)
        self.page = self.context.new_page()
        self.errors, self.requests, self.dialogs = [], [], []
        self.page.on("console", lambda message: self.errors.append(message.text))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("dialog", lambda dialog: (self.dialogs.append(dialog.message), dialog.dismiss()))
        self.page.goto(path.as_uri())
        self.settle()

    def settle(self):
        """Wait until pending changes are drawn."""
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def pixels(self, number=0):
        """Return the number of pixels of a view by colour."""
        self.settle()
        return self.page.locator("canvas").nth(number).evaluate(PIXEL_COUNTS)

    def shown(self):
        return self.page.locator("#shown").inner_text()

    def close(self):
        self.context.close()
        assert self.errors == []
        assert len(self.requests) == 1, "only the file itself"
        assert self.dialogs == []
