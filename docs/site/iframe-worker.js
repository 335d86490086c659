/* Browsers start no worker from a file: the search's runs in a hidden frame instead. The name tells the theme's
   plugin `offline` that this is here; it would name a script of another host. */
class FrameWorker extends EventTarget {
  constructor(url) {
    super();
    const frame = document.createElement("iframe");
    frame.hidden = true;
    document.body.append(frame);
    this.inner = frame.contentWindow;
    window.addEventListener("message", ({ source, data }) => {
      if (source === this.inner) this.dispatchEvent(new MessageEvent("message", { data }));
    });
    this.inner.postMessage = (data) => window.dispatchEvent(new MessageEvent("message", { data, source: this.inner }));
    this.inner.importScripts = async (...urls) => {
      for (const each of urls) await this.load(each);
    };
    this.ready = this.load(url);
  }

  load(url) {
    const script = this.inner.document.createElement("script");
    script.src = url;
    return new Promise((resolve, reject) => {
      Object.assign(script, { onload: resolve, onerror: reject });
      this.inner.document.body.append(script);
    });
  }

  postMessage(data) {
    this.ready.then(() => this.inner.dispatchEvent(new MessageEvent("message", { data })));
  }
}

if (location.protocol === "file:") window.Worker = FrameWorker;
