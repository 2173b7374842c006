"""Drawing that keeps up where a browser has no graphics card, and says so.

Such a browser draws on the same cores that trace rays, and a frame that is smoothed along edges (multisampling) takes
it half as long again. viser's client has no setting for that: a few lines of script that go before it ask for a space
without, there only. In place of viser's own notice, which lies over the plan and takes clicks, one line tells it.
"""

#: What a page says that draws so.
TOLD = "No graphics card: drawn by software, without smooth edges"
#: Goes before the client.
SCRIPT = (
    """<style>#webgl-software-rendering{display:none}</style>
<script>(() => {
  const make = HTMLCanvasElement.prototype.getContext;
  const probe = make.call(document.createElement('canvas'), 'webgl2');
  const told = probe && probe.getExtension('WEBGL_debug_renderer_info');
  const renderer = told ? String(probe.getParameter(told.UNMASKED_RENDERER_WEBGL)) : '';
  if (probe) probe.getExtension('WEBGL_lose_context')?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software/i.test(renderer)) return;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return make.call(this, kind, String(kind).startsWith('webgl') ? {...options, antialias: false} : options);
  };
  addEventListener('DOMContentLoaded', () => {
    const line = document.createElement('div');
    line.textContent = '"""
    + TOLD
    + """';
    line.style.cssText = 'position:fixed;left:.6em;top:.4em;z-index:2;pointer-events:none;'
      + 'font:11px system-ui,sans-serif;color:#666';
    document.body.append(line);
  });
})();</script>"""
)
